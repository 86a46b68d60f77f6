"""Contact machinery: points against colliders (`ColliderContacts`), and its stages in a plan (`ContactMethod`)."""

from wsim.physics.contact.contacts import CollidablePoints, ColliderContacts
from wsim.physics.contact.method import ContactMethod

__all__ = ["CollidablePoints", "ContactMethod", "ColliderContacts"]
