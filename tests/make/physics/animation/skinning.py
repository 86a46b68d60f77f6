"""What tests/physics/animation/test_skinning.py shares with other tests: nearest_faces, track."""

import numpy as np
import warp as wp


def track(sim) -> tuple[np.ndarray, np.ndarray]:
    """World points of the one mesh at the substeps of the last frame, (times, n, 3), and the times [s]."""
    contacts = sim.plan.ports.contacts
    (mesh,) = contacts.meshes.values()
    found = mesh.device["track"].numpy().astype(np.float64)
    times = contacts.time + np.arange(len(found)) * contacts.dt / (len(found) - 1)
    motion = mesh.surface.poses.skeleton.motion
    return np.stack([motion.points(x, t) for x, t in zip(found, times, strict=True)]), times


@wp.kernel(module="test_refit")
def nearest_faces(mesh: wp.uint64, q: wp.array(dtype=wp.vec3f), way: wp.array(dtype=wp.vec3f), out: wp.array(dtype=wp.vec4f)):
    i = wp.tid()
    near = wp.mesh_query_point_sign_normal(mesh, q[i], 10.0)
    wound = wp.mesh_query_point_sign_winding_number(mesh, q[i], 10.0)
    ray = wp.mesh_query_ray(mesh, q[i], wp.normalize(way[i]), 10.0)
    out[i] = wp.vec4f(float(near.face), near.sign, wound.sign, ray.t)
