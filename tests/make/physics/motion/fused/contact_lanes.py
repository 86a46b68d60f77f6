"""What tests/physics/motion/fused/test_contact_lanes.py shares with other tests: TURN."""

import numpy as np

TURN = np.array([[0.8, 0.6, 0.0, 0.0], [-0.6, 0.8, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
