"""Tables and series of material laws."""
