"""What acts on material points from outside: loads, air and pins."""
