"""Contacts with colliders in Newton steps."""
