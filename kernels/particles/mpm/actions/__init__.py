"""What acts on material points from outside: sources and sinks, loads, air, and pins."""
