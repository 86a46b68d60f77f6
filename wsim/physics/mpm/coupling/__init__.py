"""Material points that push rigid bodies, cloth and soft bodies."""
