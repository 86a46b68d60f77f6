"""Strands that meet rigid bodies, both ways: a body's motion is among the unknowns of the strands' substeps
(coupled_newton.py), which are those of the bodies (wsim/physics/rigid/touch/substeps.py). Equations:
kernels/rigid/touch/strands.py.

A substep of strands stands between the forces on bodies and the sweeps over their own contacts: what bears a body otherwise
pushes it back there. Contacts of a point with bodies are counted; where there are more than there is room for, the frame is
repeated with room. A point and the edge behind it share theirs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.math.real import types
from wsim.kernels.rigid.touch import strand_contacts, strand_forces, strand_ties, strands
from wsim.kernels.rigid.touch.points import group_bound_kernel
from wsim.kernels.rods.tables import RodContacts
from wsim.model.stage import Remedy
from wsim.model.state import StateField
from wsim.model.structs import fill_struct
from wsim.physics.contact.collider.mesh import ColliderMesh
from wsim.physics.rigid.meetings import collider_places_in_body
from wsim.physics.rigid.solids import bodies_met_by_strands
from wsim.physics.rods.colliders import StrandObstacles, strand_collider_kinds
from wsim.physics.rods.objects import strand_neighbours
from wsim.scene import Surface
from wsim.scene.attachments import body_ties, tie_places
from wsim.scene.solids import Plane, shape_row

if TYPE_CHECKING:
    from wsim.physics.rods.coupled_newton import CoupledStrands

CLING = tuple(field for key, site in (("", "a point"), ("1", "the first place within the edge behind it"),
                                      ("2", "the second place there"))
              for field in (StateField(f"cling{key}", "m", True, f"bristle of {site} that touches a rigid body", "vec3d"),
                            StateField(f"bears{key}", "N", True, f"normal force of a rigid body on {site}", "double")))
TIED = (StateField("tie", "N", True, "force of the rigid body that a point is tied to", "vec3d"),)
FULL = "rods on bodies"                # status word
ROOM, WIDE, ENTRIES = 3, 16, 1 << 14   # contacts of a point and its edge, at first: of few points WIDE, ENTRIES in all


def body_module_suffix(scene, real) -> str:
    """What stands in the name of the module of kernels that meet the bodies of a scene: kinds of shapes, precision."""
    shapes = [c for _, colliders in bodies_met_by_strands(scene) for c in colliders]
    found = strand_collider_kinds([ColliderMesh.build(c) if isinstance(c.shape, Surface) else None for c in shapes], shapes)
    return "_".join(("_bodies", *sorted(set(found)), types(real).name))


class StrandBodyContacts:
    """rigid: the method of the bodies (`wsim.physics.rigid.method.RigidMethod`)."""

    def __init__(self, together: CoupledStrands, rigid):
        self.together, self.rigid, self.status = together, rigid, together.status
        self.ground, s = together.ground, together.strands
        self.status.reserve(FULL)
        meeting = {id(body): colliders for body, colliders in bodies_met_by_strands(s.model.scene)}
        owners = [(k, world, c) for k, (body, world) in enumerate(rigid.bodies) for c in meeting.get(id(body), ())]
        own, rows = [c for *_, c in owners], [k for k, *_ in owners]
        self.shapes = StrandObstacles(own, s.model.device, 0)
        self._tables(owners, collider_places_in_body([rigid.masses[k] for k in rows], own, np.zeros((len(own), 3))), s)
        real, module = s.model.real, self.ground.module
        self.place, self.pose = strand_contacts.strand_body_kernels(real, module)
        self.nearing, self.anew = strand_contacts.near_body_kernels(self.shapes.kinds, module)
        self.meeting, self.gathering = strand_forces.body_contact_kernels(self.shapes.kinds, module)
        self.keys = strands.body_key_kernel(module)
        self.leaning, self.crossing, self.measuring, self.taking = strands.body_newton_kernels(module)
        self.pushing = strands.body_motion_force_kernel(module)
        self.giving, self.cling = strands.strand_end_kernels(real, module)
        self.bounds = group_bound_kernel(module)
        self.gap: Any = None
        if "tie" in s.part.arrays:
            put_ties(self, rigid, s)
            self.gap = self.ground.upload(np.zeros(self.ground.points), wp.float64)
            self.keeping = strand_ties.tie_end_kernel(module)
        self.depth = max(ROOM, min(WIDE, ENTRIES // self.ground.points))
        self.room()

    def _tables(self, owners: list, places: np.ndarray, s) -> None:
        """Constants, and room for what a substep finds."""
        device, n, shapes = self.ground.device, len(self.rigid.bodies), len(owners)
        worlds = np.array([world for _, world in self.rigid.bodies])
        two, part = (s.table.longest, s.table.strands), s.part.arrays
        balls = np.array([self._shape_bounding_ball(k) for k in range(shapes)]).reshape(-1, 4)

        def zeros_for_bodies(dtype, *shape):
            return wp.zeros(shape, dtype=dtype, device=device)

        def up(values, dtype):
            return self.ground.upload(values, dtype) if len(values) else zeros_for_bodies(dtype, 0)
        self.world = up(worlds.astype(np.int32), int)
        self.carried = fill_struct(
            strands.RodBodies, begin=up(self.rigid.origin, wp.vec3d), body=up(np.array([k for k, *_ in owners], np.int32), int),
            world=up(np.array([w for _, w, _ in owners], np.int32), int), place=up(places, wp.transformd),
            size=up(balls, wp.vec4d), strand=self.together.group.world, m=zeros_for_bodies(wp.float64, n),
            J=zeros_for_bodies(wp.mat33d, n), ball=zeros_for_bodies(wp.vec4d, shapes),
            **{f"{name}{key}": part[f"{field}{key}"].reshape(two) for key in ("", "1", "2")
               for name, field in (("stick", "cling"), ("load", "bears"))},
            **{name: zeros_for_bodies(wp.vec3d, n) for name in ("c0", "c1")},
            **{name: zeros_for_bodies(wp.quatd, n) for name in ("q0", "q1")},
            **{name: zeros_for_bodies(wp.vec3d, n, 2) for name in ("xi", "r", "z", "last")},
            **{name: zeros_for_bodies(wp.transformd, shapes) for name in ("pose0", "pose1")})
        size = np.full(n, np.inf)
        for (k, *_), ball in zip(owners, balls, strict=True):
            size[k] = max(size[k], ball[3]) if np.isfinite(size[k]) else ball[3]
        first = np.searchsorted(worlds, np.arange(s.model.worlds + 1)).astype(np.int32)
        points, sites = self.ground.points, int(strand_contacts.SITES)
        self.borne = fill_struct(
            RodContacts, first=up(first, int), start=zeros_for_bodies(int, n + 1), size=up(size, wp.float64),
            near=zeros_for_bodies(int, s.model.worlds), pull=zeros_for_bodies(wp.vec3d, points),
            **{name: getattr(self.together.group, name) for name in ("rough", "count", "on", "back")},
            y=zeros_for_bodies(wp.vec3d, n, 2), many=zeros_for_bodies(int, points), push=zeros_for_bodies(wp.vec3d, points),
            s=zeros_for_bodies(wp.vec3d, points, sites),
            **{name: zeros_for_bodies(wp.float64, points, sites) for name in ("N", "deep", "load")},
            **{name: zeros_for_bodies(wp.float64, n) for name in ("left", "ahead", "gain")},
            **{name: zeros_for_bodies(wp.mat33d, n) for name in ("P", "X", "H")})
        self.word = zeros_for_bodies(int, 1)
        for name, kind in (("lift", wp.vec3d), ("firm", wp.mat33d), ("bridge", wp.mat33d)):
            setattr(s.trial, name, zeros_for_bodies(kind, *two))

    def _shape_bounding_ball(self, k: int) -> tuple:
        """Middle and radius of a ball about a shape, in its frame [m]; of one without an end 1e9."""
        mesh = self.shapes.meshes[k]
        if mesh is not None:
            return (*mesh.center, mesh.radius)
        shape = self.shapes.colliders[k].shape
        return (0.0, 0.0, 0.0, 1e9 if isinstance(shape, Plane) else shape_row(shape).ball(shape))

    def room(self) -> None:
        """Arrays of contacts, `depth` of a point and the edge behind it."""
        points, B, device = self.ground.points, self.borne, self.ground.device
        for name, kind in (("body", int), ("u", wp.float64), ("arm", wp.vec3d), ("f", wp.vec3d), ("K", wp.mat33d)):
            setattr(B, name, wp.zeros((points, self.depth), dtype=kind, device=device))
        self.count = points * self.depth
        self.numbers, B.slot = (wp.zeros(2 * self.count, dtype=int, device=device) for _ in range(2))
        wp.utils.radix_sort_pairs(self.numbers, B.slot, self.count)      # takes its memory, which a capture cannot

    # a substep

    def launch(self, kernel, dim: int, inputs: list, outputs: list) -> None:
        self.ground.launch(kernel, dim, inputs, outputs)

    def over(self, kernel, *given) -> None:
        """Launches a kernel over bodies."""
        self.launch(kernel, len(self.rigid.bodies), list(given), [])

    def moved(self, kernel, *given) -> None:
        """Launches a kernel that moves bodies, and one of what that does to points."""
        self.over(kernel, *given)
        self.launch(self.pushing, self.ground.points, [self.borne, self.together.table.strands], [])

    def begin(self) -> None:
        """Where bodies are and go, and which worlds have one near a strand."""
        t, s, W, B = self.together, self.together.strands, self.carried, self.borne
        self.word.zero_()
        B.near.zero_()
        W.h = t.h
        self.over(self.place, self.rigid.contacts.rig(), W, B)
        self.launch(self.pose, len(W.body), [W], [])
        self.launch(self.nearing, self.ground.points, [self.shapes.table, s.strands, t.motion, s.trial, W, B], [self.word])
        wp.capture_if(self.word, self._restart_strand_bodies)

    def _restart_strand_bodies(self) -> None:
        t = self.together
        self.launch(self.anew, self.ground.points, [t.strands.strands, self.carried, self.borne, t.motion], [])

    def meet(self) -> None:
        """Contacts in the trial, in the order of bodies, in an iteration."""
        wp.capture_if(self.word, self._meet)

    def _meet(self) -> None:
        t, W, B, n = self.together, self.carried, self.borne, len(self.rigid.bodies)
        self._points()
        self.launch(self.gathering, self.ground.points, [t.strands.strands, W, B], [t.strands.trial])
        self.launch(self.keys, self.count, [B, n], [self.numbers, B.slot])
        wp.utils.radix_sort_pairs(self.numbers, B.slot, self.count)
        self.launch(self.bounds, n + 1, [self.numbers, self.count], [B.start])

    def _points(self) -> None:
        t, s = self.together, self.together.strands
        self.launch(self.meeting, self.ground.points, [self.shapes.table, s.strands, t.motion, s.trial, self.carried,
                                                       self.borne], [self.status.word(FULL)])

    def lean(self) -> None:
        """Systems of bodies."""
        wp.capture_if(self.word, lambda: self.moved(self.leaning, self.carried, self.borne, self.together.words))

    def cross(self) -> None:
        """What bodies give way as points are moved by G.p."""
        t = self.together
        wp.capture_if(self.word, lambda: self.moved(self.crossing, t.strands.strands, t.group, self.borne))

    def measure(self) -> None:
        """Corrections of bodies."""
        s = self.together.strands
        wp.capture_if(self.word, lambda: self.over(self.measuring, s.strands, s.trial, self.carried, self.borne))

    def take(self) -> None:
        wp.capture_if(self.word, self._take)

    def _take(self) -> None:
        self.over(self.taking, self.together.group, self.carried, self.world)
        self.launch(self.pose, len(self.carried.body), [self.carried], [])

    def give(self) -> None:
        """Momenta of bodies."""
        wp.capture_if(self.word, lambda: self.over(self.giving, self.carried, self.borne, self.rigid.contacts.rig()))

    def hold(self) -> None:
        """What points and edges remember of a substep."""
        wp.capture_if(self.word, self._points)
        if self.gap is not None:
            s = self.together.strands
            self.launch(self.keeping, self.ground.points, [s.strands, s.trial, self.carried, self.borne, self.gap], [])
        self.launch(self.cling, self.ground.points, [self.borne, self.carried], [])

    # around a frame

    def find_remedies(self) -> list[Remedy]:
        wanted = int(self.status.said(FULL)[0])

        def grow_body_contacts() -> str:
            self.depth = wanted + 1
            self.room()
            return f"{wanted} rigid bodies touched a point of rods or the edge behind it, more than there was room for"
        return [Remedy("grow", grow_body_contacts)] if wanted > self.depth else []

    def indicators(self) -> dict[str, float]:
        """Points and edges that press a rigid body where the last substep ended, and how deep they are in it [m]; the
        largest gap of a tie [m]."""
        N, deep = self.borne.N.numpy(), self.borne.deep.numpy()
        ties = {} if self.gap is None else {"rod_tie_gap": float(self.gap.numpy().max(initial=0.0))}
        return {"rod_bodies": float(np.count_nonzero(N)), "rod_body_depth": float(deep.max(initial=0.0))} | ties


def put_ties(contacts: Any, rigid: Any, strands: Any) -> None:
    """Fills the tables of ties of `wsim.physics.rods.bodies.StrandBodyContacts`. rigid: the method of the bodies; strands: that
    of the rods."""
    t, scene, W = strands.table, strands.model.scene, contacts.carried
    rows = {(body.path, world): k for k, (body, world) in enumerate(rigid.bodies)}
    n = t.longest * t.strands
    tied, at, passes = np.full(n, -1, np.int32), np.zeros((n, 3)), np.full((n, 4), -1, np.int32)
    for (rods, world), place in zip(t.pairs, t.place, strict=True):
        for tie in body_ties(scene, rods.path):
            k = rows[tie.other, world]
            m, body = rigid.masses[k], rigid.bodies[k][0]
            local = rotation.quat_rotate(rotation.quat_conjugate(m.axes), tie_places(tie, rods, body) - m.center)
            tied[place[tie.points]], at[place[tie.points]] = k, local
            for point in tie.points.tolist():
                for side, found in enumerate(strand_neighbours(rods.counts, point, rods.closed)):
                    for row in place[found]:
                        own = passes[row, 2 * side:2 * side + 2]
                        if k not in own:
                            own[0 if own[0] < 0 else 1] = k
    two, up = (t.longest, t.strands), contacts.ground.upload
    W.tied, W.tie_at = up(tied.reshape(two), int), up(at.reshape(*two, 3), wp.vec3d)
    W.passes, W.tie = up(passes.reshape(*two, 4), wp.vec4i), strands.part.arrays["tie"].reshape(two)
