"""The material point method: jelly, snow, sand and water as particles that meet on a sparse grid."""
