"""Why a scene needs each method, and why it is left out where it does not."""

from wsim.physics.cloth.constraints import HARD, Rows
from wsim.scene import Scene
from wsim.simulation.choice import Choice


def why(scene: Scene, choice: Choice, rows: dict[str, list[Rows]]) -> dict[str, str]:
    """For each method: why the scene needs it, or "" and it is not even imported."""
    hard = any(r.kind in HARD for found in rows.values() for r in found)
    wind = any(c.drag or c.lift for c in scene.cloths)
    kinds = sorted({type(c.shape).__name__.lower() for c in scene.colliders})
    return {
        "points": "there are points that move",
        "pins": f"{len(scene.pins)} pins" if scene.pins else "",
        "muscles": "springs have an actuation" if any(s.actuation for s in scene.springs) else "",
        "loads": f"{len(scene.loads)} loads" if scene.loads else "",
        "aero": "a cloth has drag or lift" if wind else "",
        "explicit": choice.why if choice.solver == "explicit" else "",
        "implicit": choice.why if choice.solver == "implicit" else "",
        "xpbd": choice.why if choice.solver == "xpbd" else "tethers or strain limits" if hard else "",
        "fem": f"{sum(len(s.tets) for s in scene.softs)} tets" if scene.softs else "",
        "contact": f"colliders: {', '.join(kinds)}" if kinds else "",
    }


WITHOUT = {"explicit": "another solver is chosen", "implicit": "another solver is chosen",
           "xpbd": "another solver is chosen, and nothing is hard",
           "pins": "nothing is pinned", "muscles": "no spring has an actuation", "loads": "nothing is loaded",
           "aero": "no cloth has drag or lift", "contact": "there is no collider",
           "history": "backward Euler needs no earlier step", "fem": "there is no soft body",
           "rigid": "there is no rigid body", "fluid": "there is no fluid", "gradients": "not asked for"}
