"""Values of a scene: named numbers, vectors and arrays, a row each in one table (`wsim.scene.values.table`)."""
