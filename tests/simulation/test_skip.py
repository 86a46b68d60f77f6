"""Skip by construction: what an example scene lacks is neither imported, compiled, planned nor allocated.

Each scene is loaded, built and stepped once in a process of its own, which then tells what it imported and compiled; scenes of
which only the kernels are looked at share a process.
"""

import json
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.usd import save

ROOT = Path(__file__).resolve().parents[2]

STEP = """
import json, sys
import warp as wp
from wsim.usd import load
from wsim.simulation.simulation import Simulation
for path in sys.argv[1:]:
    sim = Simulation(load(path), device="cpu")
    sim.step()
    name = sim.model.module
    modules = [wp.get_module(n) for n in {name, sim.model.sweep_module, sim.model.step or name, name + "_apart"}]
    kernels = [k for m in modules for k in m.kernels.values()]
    adjoint = [k.key for k in kernels if k.options.get("enable_backward", k.module.options["enable_backward"])]
    print(json.dumps({"kernels": sorted(k.key for k in kernels), "adjoint": adjoint,
                      "modules": [m for m in sys.modules if m.partition(".")[0] in ("wsim", "kernels", "rerun", "pxr")],
                      "methods": [m.name for m in sim.plan.methods],
                      "fields": [f.name for f in sim.state.points.fields],
                      "skipped": [s["stage"] for s in sim.plan.skipped]}))
"""

# what every scene of cloth needs by explicit steps among contacts
LEAPS = {"explicit_begin_kernel", "position_commit_kernel", "velocity_correction_kernel", "fused",
         "resting_kick_kernel", "overstretch_kernel", "not_finite_kernel"}   # fused has air, contacts, `correct`
PINS, AIR = {"pin_motion_kernel"}, {"triangle_drag_kernel", "air_displacement_kernel"}
BEND = {"dihedral", "target"}
CLOTH = {"membrane"} | BEND
EDGES = {"feel_edges_box", "find_edges_box", "gather_edges"}      # of cloths, against sharp colliders
KERNELS = {
    "hanging_cloth": {"sheet_march_kernel", "overstretch_kernel", "not_finite_kernel"},
    "flag": LEAPS | AIR | {"leapfrog_drag_kernel", "leapfrog_air_kernel", "sheet_march_kernel", "blow_work"},
    "cape": LEAPS | AIR | {"leapfrog_drag_kernel", "leapfrog_air_kernel", "sheet_march_kernel",
                           "search_sphere", "contact", "push_work"},
    "tablecloth": LEAPS | {"sheet_march_kernel", "contact",
                           "search_plane_box", "clearance_plane_box", "near_plane_box"} | EDGES,
    "shirt": LEAPS | {"sheet_march_kernel",
                      "search_solid_f32_listed", "contact", "clearance_solid", "near_solid"},
}


def room(place: str, names: str) -> set[str]:
    return {f"wsim.{place}.{name}" for name in names.split()}


SCENE = (room("scene", "scene attachments bodies solids curve.curve curve.motion fabric")
         | room("scene.check", "arguments scene objects mesh problem") | room("scene.values", "arrays table value cost")
         | room("physics.cloth", "objects check") | room("geometry", "triangulate topology memo rotation"))
LOADER = room("geometry", "primitives winding")       # read with wsim.usd, whose own modules are not told apart by scene
RUN = (room("simulation", "simulation plan choice methods cost retry duration interrupt")
       | room("simulation.predicted", "errors measured growth sweep_strain sag rolling")
       | room("simulation.measure", "captures indicators exceeded host log_messages readings checks.lost")
       | room("scene.nodal", "masses separate touching") | room("scene", "integrator methods samples")
       | room("model", "stage ports state status model midnodes launches kernel_cache structs vjp warp_private")
       | room("model.compiler", "variants source header recorded version core_sharing core_team")
       | room("scene.check", "counts") | room("geometry", "sheet_ordering ordering color color_chains")
       | room("physics.motion", "points divergence_monitor stability")
       | room("physics.cloth", "constraints kind kinds.membrane kinds.dihedral")
       | room("kernels", "math.real math.marks motion.points cloth.spring"))
CHECKS = (room("simulation.measure.checks", "balance terms reasons rise works") | room("kernels.math", "ledger point_energy")
          | room("kernels", "cloth.energy cloth.constraint cloth.terms") | {"wsim.physics.cloth.table"}
          | {"wsim.model.compiler.parallel"})
PINNED = {"wsim.physics.motion.pins", "wsim.scene.check.pins"}
AERO = {"wsim.physics.cloth.air", "wsim.kernels.cloth.air"}
CONTACT = (room("physics.contact", "contacts colliders method free_flight_test") | room("physics.contact.collider",
                                                                                        "mesh") | room("scene.check", "contact")
           | {"wsim.physics.contact.collider.rows", "wsim.kernels.contact.collider.colliders"}
           | room("scene.check", "signed_distance chord sharp") | room("kernels.contact", "project search collide mesh")
           | room("kernels.contact.collider", "shape") | {"wsim.kernels.motion.free_flight_test"})
LEAP = (room("physics.motion", "explicit forces") | room("physics.motion.fast_paths",
                                                         "threads cluster simd_springs simd_sheets")
        | room("physics.cloth", "bending curvature elements table")
        | room("kernels.motion.fast_paths",
               "threads cluster simd_springs march_cpu simd_sheets sheet_march") | room("kernels.motion", "explicit")
        | {"wsim.kernels.math.block"}
        | room("kernels.cloth", "constraint element curvature terms"))
FUSED = (room("physics.motion.fused",
              "kernel_fusion persistent_kernel recorder source") | room("kernels.motion", "fused.body fast_paths.thread_team"))
OUTLINE = {"wsim.physics.contact.poses.swept_bounds"}               # of colliders, for frames without contacts
SHARP = room("physics.cloth", "edge_contacts") | room("kernels.cloth.edge_contact", "sites gather edge corner")
MOVED = (room("kernels", "animation.motion animation.pinned animation.collider math.rotation math.eigen")    # by keys
         | {"wsim.physics.animation.pin_targets", "wsim.physics.contact.poses.sampled"})
WHOLE = room("physics.motion.fast_paths", "one_launch")
SLIVERS = room("physics.motion.fused", "mass_scaling")                   # with whose mass leapfrog is weighed where it is dear
LISTED = {"wsim.physics.contact.broad", "wsim.kernels.contact.candidates"}      # triangles near enough for some frames
MANY = room("scene.check", "slivers")                          # a look for triangles that make steps many
WEIGHED = room("physics.motion", "frequency")                  # where leapfrog comes into question
MODULES = {
    "hanging_cloth": SCENE | RUN | CHECKS | WEIGHED | LEAP | WHOLE | PINNED | MANY,
    "flag": SCENE | RUN | CHECKS | WEIGHED | LEAP | FUSED | AERO | PINNED,
    "cape": SCENE | RUN | CHECKS | WEIGHED | LEAP | FUSED | AERO | CONTACT | PINNED | SLIVERS | MANY
    | MOVED | room("kernels", "contact.penetration"),                       # work of colliders that move
    "tablecloth": SCENE | RUN | CHECKS | WEIGHED | LEAP | FUSED | WHOLE | CONTACT | OUTLINE | SHARP
    | room("kernels", "math.face"),                                         # sides of closed meshes, beside edges
    "shirt": SCENE | RUN | CHECKS | WEIGHED | LEAP | FUSED | WHOLE | CONTACT | OUTLINE | SLIVERS | LISTED
    | room("kernels", "math.face") | room("geometry", "tetra.lattice"),     # distances of its dummy; what starts inside
}
scenes = pytest.mark.parametrize("name", KERNELS)


def step(*paths: Path, **environment) -> list[dict]:
    done = subprocess.run([sys.executable, "-c", STEP, *map(str, paths)], cwd=ROOT, capture_output=True, text=True,
                          check=False, env=os.environ | environment)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


@cache
def stepped(name: str) -> dict:
    return step(ROOT / "scenes" / f"{name}.usda")[0]


def subject(kernel: str) -> str:
    """A kernel without its precision, its variant and how its colours are launched: project_dihedral_lam_f32 is dihedral."""
    bare = re.sub(r"_f(32|64)$|(?<=^fused)_.*$", "", kernel.partition("__locals__")[0])
    return re.sub(r"^(?:project|sweep)_([a-z]+).*$", r"\1", bare)


@scenes
def test_exactly_the_kernels_of_the_scene_are_compiled(name):
    found = [subject(k) for k in stepped(name)["kernels"]]
    assert len(found) == len(set(found)) and set(found) == KERNELS[name]


@scenes
def test_exactly_the_modules_of_the_scene_are_imported(name):
    found = {m for m in stepped(name)["modules"] if m.startswith("wsim") and not m.startswith("wsim.usd")}
    rooms = {m.rpartition(".")[0] for m in found} | {"wsim.physics.contact.poses"}
    assert found - rooms - LOADER - {"wsim.scene", "wsim.kernels"} == MODULES[name]


@scenes
def test_no_viewer_no_writer_and_no_second_copy_of_the_kernels(name):
    modules = set(stepped(name)["modules"])
    assert not any(m.partition(".")[0] in ("rerun", "kernels") for m in modules) and "pxr" in modules
    assert not any(m.startswith(("wsim.show", "wsim.cli", "wsim.fitting", "wsim.bench", "wsim.gradient")) for m in modules)
    assert not modules & room("usd.result", "recorder restart")


@scenes
def test_no_adjoint_is_compiled(name):
    assert stepped(name)["adjoint"] == []


@scenes
def test_methods_arrays_and_reasons_agree(name):
    found = stepped(name)
    wanted = {"points", "explicit"} if "sheet_march_kernel" in KERNELS[name] else {"points", "xpbd", "watch"}
    wanted |= {"balance"}
    wanted |= {"pins"} if MODULES[name] >= PINNED else set()
    wanted |= {"aero"} if KERNELS[name] >= AIR else set()
    wanted |= {"contact"} if "contact" in KERNELS[name] else set()
    assert set(found["methods"]) == wanted
    assert set(found["skipped"]) == {"pins", "muscles", "loads", "aero", "contact", "history", "explicit", "implicit", "xpbd",
                                     "fem", "rigid", "fluid", "liquid", "mpm", "arrivals", "grains", "density",
                                     "rods", "follow", "bones", "selfcontact",
                                     "shape_matching",
                                     "gradients"} - wanted
    assert ("a" in found["fields"]) == bool({"contact", "aero"} & wanted) and not {"s", "u"} & set(found["fields"])


def test_an_empty_cache_ends_with_one_module_and_those_of_the_balance(tmp_path):
    """Sources that Warp wrote: one module of the scene, a forward function for each kernel, no backward one. Those of the
    energy balance are of no scene, and are made once for all."""
    (found,) = step(ROOT / "scenes" / "hanging_cloth.usda", WARP_CACHE_PATH=str(tmp_path))
    every = {p.parent.name: p for p in tmp_path.rglob("wp_wsim_*.cpp")}
    of_all = {name for name in every if name.startswith(("wp_wsim_ledger", "wp_wsim_balance", "wp_wsim_report"))}
    compiled = {p.parent.name for p in tmp_path.rglob("*.o")} | {p.parent.name for p in tmp_path.rglob("*.cpp")}
    assert compiled == every.keys() and len(of_all) == 4          # the ledger, points, membranes, hinges
    (source,) = (path for name, path in every.items() if name not in of_all)
    text = source.read_text()
    forward = re.findall(r"static void (\w+?)_[0-9a-f]+_cpu_kernel_forward\(", text)
    assert sorted(subject(k) for k in forward) == sorted(KERNELS["hanging_cloth"]) and len(found["kernels"]) == len(forward)
    assert "_cpu_kernel_backward(" not in text


CHANGES = {"bend": CLOTH - BEND, "springs": {"distance"} | BEND, "bdf2": CLOTH | {"residual", "residual_verdict_kernel"},
           "limit": CLOTH | {"limit"}, "tethers": CLOTH | {"tether"}, "nothing": CLOTH}


def changed(change: str) -> Scene:
    fabric = Fabric(bend=0.0 if change == "bend" else 1e-4, strain_limit=0.1 if change == "limit" else float("inf"))
    scene = Scene(frames=1, substeps=2, solver="xpbd", integrator="bdf2" if change == "bdf2" else "auto")
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 3, 3, cut="quads"), material=fabric, tethers=change == "tethers",
                        model="springs" if change == "springs" else "membrane")
    scene.pin("/pin", cloth, [0, 3])
    return scene


def test_a_change_of_the_scene_changes_just_its_kernels(tmp_path):
    for change in CHANGES:
        save(changed(change), str(tmp_path / f"{change}.usda"))
    all_ = step(*(tmp_path / f"{change}.usda" for change in CHANGES))
    for (change, kernels), told in zip(CHANGES.items(), all_, strict=True):
        moves = {"euler_prediction_kernel", "euler_finish_kernel"}
        moves |= {"bdf2_prediction_kernel", "bdf2_finish_kernel"} if change == "bdf2" else set()
        found = {re.sub("^residual_(membrane|dihedral)$", "residual", subject(k)) for k in told["kernels"]}
        assert found == kernels | PINS | {"not_finite_kernel", "overstretch_kernel"} | moves, change


def test_a_soft_body_compiles_its_own_material_and_no_constraint():
    found = stepped("cantilever")
    kernels = {subject(k) for k in found["kernels"]}
    assert {k[4:] for k in kernels if k.startswith("fem")} == {"linearise_corotational_damped", "change_corotational_damped"}
    assert not kernels & (CLOTH | {"distance", "contact"}) and found["adjoint"] == [] and "xpbd" in found["skipped"]
