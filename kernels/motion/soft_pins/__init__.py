"""Soft pins in Newton steps."""
