"""Contact machinery: points against colliders (`Contacts`), and its stages in a plan (`Contact`)."""

from wsim.physics.contact.contacts import Bodies, Contacts
from wsim.physics.contact.method import Contact

__all__ = ["Bodies", "Contact", "Contacts"]
