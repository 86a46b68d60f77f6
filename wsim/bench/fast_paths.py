"""The registry of fast paths: code besides the general path that gives the same answer sooner on some device for some sizes.

A row says what is computed, where the fast path is taken, how it is switched off, what it gains, and which test compares it
with the general path. `python -m tools.bench.choice.fast_paths` measures the gains and prints the table of
tools/results/fast_paths.md; tests/bench/test_fast_paths.py holds rows to the code: a new file of native code needs a row, or a
reason in NATIVE.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

LEAST = 1.5              # gain below which a fast path is not worth its code


@dataclass(frozen=True)
class FastPath:
    """name      of the row, and of its scene in the tool
    law       what it computes
    device    "cpu" or "cuda"
    sizes     for which it is taken
    off       "module:attribute" and the value that switches it off where a scene is built and run
    code      files of the fast path that nothing else uses
    test      file and function that compares it with the general path
    gain      time of the general path over its own; None: not measured by the tool
    measured  where, and by what if not by the tool
    copies    whether it has a formula of the law a second time, in C++; else it calls the law's own"""

    name: str
    law: str
    device: str
    sizes: str
    off: tuple[str, Any]
    code: tuple[str, ...]
    test: str
    gain: float | None
    measured: str

    @property
    def copies(self) -> bool:
        return any(file in COPIES for file in self.code)


COPIES = {              # what Warp cannot call: lanes of Clang's vectors, registers that a whole frame stays in
    "kernels/motion/fast_paths/march_cpu.py", "kernels/motion/fast_paths/sheet_march.py", "kernels/soft/packets.py",
    "kernels/solver/sweeps/packets.py", "kernels/motion/fused/sheet.py", "kernels/motion/fused/limits.py",
    "kernels/motion/fast_paths/cluster.py", "kernels/motion/fused/conjugate.py", "kernels/position_based/packets/sums.py"}
FUSES = "wsim.model.launches:KernelLaunches.fuses"
INF = float("inf")
XEON = "two cores of a Xeon"
TOUCH = "tests/gpu/test_touch.py"


def cpu_fast_path(name: str, law: str, sizes: str, off: tuple[str, Any], code: tuple[str, ...], test: str, gain: float | None,
                  measured: str = XEON) -> FastPath:
    return FastPath(name, law, "cpu", sizes, off, code, test, gain, measured)


def cuda_fast_path(name: str, law: str, sizes: str, off: tuple[str, Any], code: tuple[str, ...], test: str,
                   gain: float | None = None, measured: str = "not yet") -> FastPath:
    return FastPath(name, law, "cuda", sizes, off, code, test, gain, measured)


ROWS = (
    cpu_fast_path("springs in one pass", "explicit steps of nets", "all",
                  ("wsim.physics.motion.forces:ForceGather.march", lambda self, module, bounded: None),
                  ("kernels/motion/fast_paths/march_cpu.py",),
                  "tests/physics/motion/fast_paths/test_simd_springs.py::test_a_substep_at_a_time_is_the_same_motion", 3.2),
    cpu_fast_path("sheets by eights", "explicit steps of membranes and hinges", "all", (FUSES, False),
                  ("kernels/motion/fast_paths/sheet_march.py",),
                  "tests/physics/motion/fast_paths/test_simd_sheets.py::test_frames_are_those_of_launch_by_launch", 6.5),
    cpu_fast_path("substeps by a team", "explicit steps of tets, and of sheets with contacts", "all", (FUSES, False),
                  ("kernels/motion/fast_paths/thread_team.py",),
           "tests/physics/motion/fused/test_thread_team.py::test_any_number_of_threads_gives_the_bits_of_launch_by_launch", 1.6,
                  "wall time on two free cores: cape 2.1, tablecloth 1.8, bear 1.5, flag 1.3"),
    cpu_fast_path("tets by eights", "corotational and neo-Hookean forces of linear tets", "all",
                  ("wsim.physics.soft.fem:PACKETS", ()), ("kernels/soft/packets.py",),
                  "tests/physics/soft/test_packets.py::test_packets_have_the_forces_of_tets_one_by_one", 2.1),
    cpu_fast_path("sweeps by eights", "XPBD of membranes and hinges", "all", ("wsim.physics.solver.batch:PACKED", False),
                  ("kernels/solver/sweeps/packets.py",),
                  "tests/physics/solver/test_sweep_packets.py::test_eight_at_a_time_are_what_one_after_the_other_are", 2.9),
    cpu_fast_path("fluids by eights", "lists, densities, pushes and viscosity of fluids by constraints", "all",
                  ("wsim.kernels.position_based.packets:LANES", 1),
                  ("kernels/position_based/packets/sums.py", "kernels/position_based/packets/lists.py"),
                  "tests/physics/position_based/test_packet_sums.py::test_a_fluid_moves_by_eights_as_one_by_one", 2.9),
    cpu_fast_path("steps of material points by a team", "explicit material points that push nothing", "all",
                  ("wsim.physics.mpm.tile_grid:TEAM", False),
                  ("kernels/particles/mpm/cpu/tiles.py", "kernels/particles/mpm/cpu/atomics.py"),
                  "tests/physics/soft/mpm/test_tiles.py::test_any_number_of_threads_gives_the_bits_of_launch_by_launch", 1.6,
                  "best frames of 64 000 particles on two cores that others use too: jelly 6.5 to 10.4 million steps a second"),
    cpu_fast_path("launches by several cores", "grains, fluids by constraints, contacts of points", "launches from 0.03 ms",
                  ("wsim.model.compiler.core_team:MOST", 1),
                  ("wsim/model/compiler/core_sharing.py", "wsim/model/compiler/core_team.py"),
                  "tests/physics/compiled/test_core_sharing.py::test_particles_move_by_the_same_bits", 1.9,
                  "two cores of a server: 130 ms of processor time in 67 ms"),
    cpu_fast_path("tree of colliders", "contacts of points", "64 colliders of an object and more",
                  ("wsim.physics.contact.contacts:MANY", 1 << 30), (),
     "tests/physics/motion/fused/test_kernel_fusion.py::test_colliders_that_a_tree_finds_are_launched_substep_by_substep", 1.7),
    cpu_fast_path("frames without contacts", "contacts of points", "colliders out of reach",
                  ("wsim.physics.contact.free_flight_test:allows_free_flight", lambda scene, gradients: False), (),
                  "tests/physics/contact/test_free_flight_test.py::test_a_far_collider_leaves_explicit_steps_their_bits", 1.5),
    cpu_fast_path("direct pressure", "pressure of smoke in a box without obstacles", "up to 800 cells along all axes together",
                  ("wsim.physics.fluid.grid.domain:MOST", 0), ("kernels/fluid/solver/diagonal.py",),
                  "tests/physics/fluid/pressure/test_direct.py", 1.6),
    cuda_fast_path("frames of sheets by blocks", "explicit steps of sheets and solids", "up to 12k points in float32, sm_90",
                   ("wsim.physics.motion.fused.domain_decomposition:LARGE_CLUSTER_ARCH", 999),
                   ("kernels/motion/fused/sheet.py", "kernels/motion/fused/limits.py", "kernels/motion/fused/lanes.py"),
                   "tests/gpu/solver/test_sheets.py", 5.6,
                   "H200; earlier: shirt on its dummy 64.3 to 22.0 ms, cape 36.0 to 10.3"),
    cuda_fast_path("frames of nets by a cluster", "explicit steps of nets", "up to 8k points, sm_90",
                   ("wsim.physics.motion.forces:_forms_clusters", lambda device: False),
                   ("kernels/motion/fast_paths/cluster.py",), "tests/gpu/solver/test_fused.py", 4.2, "H200"),
    cuda_fast_path("substeps in one launch", "explicit steps", "up to 8192 points that no blocks share", (FUSES, False),
                   ("kernels/motion/fused/body.py",), "tests/gpu/solver/test_fused.py"),
    cuda_fast_path("conjugate gradients by a cluster", "Newton steps", "up to 2048 points, sm_90",
                   ("wsim.physics.motion.fused.conjugate:LARGE_CLUSTER_ARCH", 999), ("kernels/motion/fused/conjugate.py",),
                   "tests/gpu/solver/test_conjugate.py", 4.0, "H200; H100: twist 12.7 to 3.5 ms, cantilever 3.5 to 1.2"),
    cuda_fast_path("conjugate gradients by a block", "Newton steps", "up to 1500 points",
                   ("wsim.physics.solver.linear:FUSE", {"cuda": 0, "cpu": 2**31}), ("kernels/solver/pcg.py",),
                   "tests/physics/solver/test_newton_adjoint.py::test_several_blocks_a_body_do_the_same_as_one"),
    cuda_fast_path("Schwarz domains", "Newton steps of stiff sheets", "from 3000 points",
                   ("wsim.physics.solver.schwarz.solver:PAYS", {"cpu": (INF, INF), "cuda": (INF, INF)}),
                   ("kernels/solver/schwarz/cg.py", "kernels/solver/schwarz/dense.py"), "tests/gpu/solver/test_schwarz.py", 2.0,
                   "H200; H100: a solve of a garment to 1e-2 2.5 to 1.15 ms"),
    cuda_fast_path("colours by a block", "XPBD", "colours of up to 512 constraints", ("wsim.physics.solver.batch:FUSE", 0), (),
                   "tests/physics/solver/test_xpbd_adjoint.py::test_a_launch_for_each_colour_gives_the_same_as_one_for_all",
                   1.7, "H200; a sweep of 1k points 18.6 to 9.9 us"),
    cuda_fast_path("ropes by a block", "ropes that touch", "fewer than 512 strands a world",
                   ("wsim.physics.rods.coupled_newton:TEAM", False),
                   ("kernels/rods/coupled_newton/reduction.py", "kernels/rods/coupled_newton/rounds.py",
                    "kernels/rods/coupled_newton/reduced.py"),
                   "tests/gpu/test_rods.py", 17.8, "H200: rope_knot 312 to 17.6 ms"),
    cuda_fast_path("iterations of all strands", "strands that touch no others", "all",
                   ("wsim.physics.rods.method:APART", False),
                   ("kernels/rods/gpu_elimination/desk.py",), "tests/gpu/test_rods.py", 3.0, "H200: 10000 hairs 47 to 15.6 ms"),
    cuda_fast_path("bodies and points by a block", "rigid bodies that points touch", "up to 32 bodies a world",
                   ("wsim.physics.rigid.touch.worlds:FEW", 0), ("kernels/rigid/touch/rounds.py",), TOUCH),
    cuda_fast_path("sweeps of surfaces in a launch", "self-collision by XPBD", "all",
                   ("wsim.physics.contact.selfcontact.rows.sweeps:TOGETHER", False), (), "tests/gpu/solver/test_surfaces.py"),
    cuda_fast_path("small levels by a block", "pressure by multigrid", "levels of up to 4096 cells",
                   ("wsim.physics.fluid.grid.multigrid:SMALL", 0), (), "tests/gpu/fluid/test_fluid.py", 1.6,
                   "H200: 21 to 13 us a level"),
    cuda_fast_path("direct pressure", "pressure of smoke in a box without obstacles", "up to 800 cells along all axes together",
                   ("wsim.physics.fluid.grid.domain:MOST", 0), ("kernels/fluid/solver/diagonal.py",),
                   "tests/gpu/fluid/test_smoke.py", 2.7, "H200: a step of 256 cells a side 46 to 17 ms"),
    cuda_fast_path("rigid bodies by a block", "rigid contacts", "up to HUGE shapes", ("wsim.physics.rigid.forms:HUGE", -1), (),
                   "tests/gpu/test_rigid.py"),
)
NATIVE = {              # other files with native code: what Warp cannot say
    "kernels/animation/deformed.py": "calls Warp's own refit of a tree",
    "kernels/cloth/spring.py": "shuffles within a warp",
    "kernels/fluid/sampling.py": "rows of a grid by their address; between, patch and limited are the only path",
    "kernels/fluid/steps.py": "a rounding that no compiler may contract",
    "kernels/math/block.py": "a meeting of a block's threads, reads past the caches",
    "kernels/math/compensated.py": "a rounding that no compiler may contract",
    "kernels/math/face.py": "reads the parts of Warp's meshes and trees",
    "kernels/math/ledger.py": "shuffles within a warp",
    "kernels/math/mesh_refit.py": "a refit that a loop on a GPU can hold",
    "kernels/math/team.py": "sums over teams of threads",
    "kernels/soft/clusters/rigid_contacts.py": "the largest of a block, the least number of several",
    "kernels/soft/clusters/shape_matching.py": "a sum over a block in a fixed order",
    "kernels/particles/mpm/cpu/vectors.py": "four numbers of a particle at a time on a CPU",
    "kernels/position_based/pair_sums.py": "four numbers in one read, a root by a GPU's own instruction",
    "kernels/particles/sort.py": "an order that does not depend on threads",
    "kernels/rigid/joint/tree/lanes.py": "shuffles within a warp, entries of matrices by lanes",
    "kernels/rods/coupled_newton/warps.py": "the greatest of a warp",
    "kernels/contact/selfcontact/tree.py": "reads and writes of boxes past the caches",
}
