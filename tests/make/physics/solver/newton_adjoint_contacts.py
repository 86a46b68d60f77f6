"""What tests/physics/solver/test_newton_adjoint_contacts.py shares with other tests: NEWTON."""


NEWTON = {"solver": "implicit", "integrator": "backward_euler", "substeps": 2, "iterations": 2}
