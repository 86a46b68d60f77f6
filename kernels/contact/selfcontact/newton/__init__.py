"""Contacts of surfaces in Newton steps."""
