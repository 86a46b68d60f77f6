"""Contact machinery: points against colliders (`Contacts`), and its stages in a plan (`Contact`)."""

from wsim.contact.contacts import Bodies, Contacts
from wsim.contact.stages import Contact

__all__ = ["Bodies", "Contact", "Contacts"]
