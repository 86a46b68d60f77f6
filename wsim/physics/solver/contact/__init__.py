"""Contacts with colliders in Newton steps, and their adjoints."""
