"""What tests/physics/animation/test_ragdoll.py shares with other tests: at, joints, ragdoll."""

import numpy as np

from wsim.physics.animation.objects import Skeleton
from wsim.physics.rigid.objects import Body
from wsim.scene import Capsule, Collider, Scene
from wsim.scene.curve import Motion

JOINTS = ("hip", "hip/knee", "hip/knee/foot")


def at(x: float, y: float, z: float) -> np.ndarray:
    M = np.eye(4)
    M[:3, 3] = (x, y, z)
    return M


def ragdoll(turn: float = 0.0) -> Scene:
    """Two bodies that fall apart, of three joints; the third keeps to its parent. The skeleton stands 1 m to the side."""
    scene = Scene(frames=8, fps=24.0, substeps=4)
    bind_ = np.stack([at(0.0, 1.0, 0.0), at(0.0, 1.5, 0.0), at(0.0, 2.0, 0.0)])
    place = np.eye(4)
    place[:3, :3] = [[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]]
    place[:3, 3] = (1.0, 0.0, 0.0)
    scene.add(Skeleton("/man/bones", JOINTS, bind_, motion=Motion.still(place),
                       bodies={"hip": "/low", "hip/knee": "/high"}))
    for path, y, spin in (("/low", 1.2, (0.0, 0.0, 3.0)), ("/high", 1.8, (2.0, 1.0, 0.0))):
        collider = Collider(f"{path}/shape", Capsule(0.05, 0.1))
        scene.add(Body(path, [collider], Motion.still(at(1.0, y, 0.0)), velocity=(0.3, 2.0, 0.0), spin=spin))
    return scene


def joints(sim) -> np.ndarray:
    """World transforms of the joints that a sample says, (3, 4, 4)."""
    (found,) = [s for s in sim.samples() if type(s).__name__ == "Joints"]
    from wsim.geometry import rotation
    from wsim.physics.animation.driven import skeleton_to_world
    from wsim.physics.animation.skinning import skeleton_space_transforms
    L = np.tile(np.eye(4), (3, 1, 1))
    L[:, :3, :3] = rotation.quaternion_to_matrix(found.rotations) * found.scales[:, None, :]
    L[:, :3, 3] = found.translations
    bones = sim.scene.things("Skeleton")[0]
    return skeleton_to_world(bones, sim.time) @ skeleton_space_transforms(bones.parents, L[None])[0]
