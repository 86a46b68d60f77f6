"""Points of cloth, nets and soft bodies that are tied to rigid bodies, as slots of their contacts. Equations:
kernels/rigid/touch/point_ties.py."""

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.rigid.touch.point_ties import TiedPoints, point_tie_kernel
from wsim.model.stage import Clock
from wsim.model.structs import fill_struct
from wsim.scene.attachments import body_ties, tie_places

AXES = 3                 # slots of a tied point


class PointTies:
    """touch: `wsim.physics.rigid.touch.points.BodyPointContacts`; row, bodies: its rows among colliders, and whose they are."""

    def __init__(self, touch, row: np.ndarray, bodies: np.ndarray):
        self.touch, model, rows = touch, touch.model, touch.contacts.rows
        self.kernel = point_tie_kernel(model.real, model.module)
        points, owners, own, places = [], [], [], []
        numbers = {(body.path, world): k for k, (body, world) in enumerate(touch.rigid.bodies)}
        for o, body in enumerate(model.bodies):
            there = (row >= rows.first[o]) & (row < rows.first[o + 1])
            for tie in body_ties(model.scene, body.path):
                k = numbers[tie.other, body.world]
                m = touch.rigid.masses[k]
                local = tie_places(tie, body.source, touch.rigid.bodies[k][0]) - m.center
                points.append(body.index[tie.points])
                places.append(rotation.quat_rotate(rotation.quat_conjugate(m.axes), local))
                owners.append(np.full(len(tie.points), k))
                own.append(np.full(len(tie.points), row[there & (bodies == k)][0]))
        place, first = np.unique(np.concatenate(points), return_index=True)        # welded points are held once

        def upload(values, dtype):
            return wp.array(np.ascontiguousarray(np.concatenate(values)[first]), dtype=dtype, device=model.device)
        self.count, self.points = len(place), place
        self.table = fill_struct(TiedPoints, point=wp.array(place.astype(np.int32), dtype=int, device=model.device),
                                 body=upload([v.astype(np.int32) for v in owners], int),
                                 row=upload([v.astype(np.int32) for v in own], int), place=upload(places, wp.vec3d))
        contacts = touch.contacts                                                  # they meet nothing else
        contacts.tied, w = True, contacts.points.w.numpy().copy()
        w[place] = 0.0
        contacts.points.w = wp.array(w, dtype=model.real, device=model.device)
        contacts.make_slots(max(AXES, contacts.slots.capacity))

    def write(self, clock: Clock) -> None:
        """Launches their slots, behind a search."""
        touch = self.touch
        touch.model.launch(self.kernel, self.count, [self.table, touch.shapes, touch.rigid.contacts.rig(), touch.points(clock),
                                                     clock.h], [touch.contacts.slots, touch.contacts.push])
