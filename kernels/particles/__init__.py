"""Particles that carry matter through a grid: their order by cell, transfers, motion, seeding and removal."""
