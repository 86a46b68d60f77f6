"""Writes a run as a result layer: a new file over the untouched scene, holding only what the run changed.

    with Recorder(scene, "flag.usdc") as recorder:
        recorder.append(recorder.time_code(0), {"/flag": positions}, {"/flag": velocities})

The result sublayers the scene's file by a relative path and has `over`s alone: time samples of points, velocities, normals
and extent, of bodies and skins that follow them (`wsim.scene.nodal.skin`), and the surface of a soft body without a skin.
Default values stay those of the source, because unauthored rest shapes are read from them. The file grows under a name of its
own and is renamed when it is whole: `wsim.usd.result.partial` says what stays of a run that does not get so far."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pxr import Usd, UsdUtils

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.bodies import bodies_sampled_by_point
from wsim.scene.nodal.skin import embed_all_skins
from wsim.usd.prims.reactions import reaction_samples_of_pins
from wsim.usd.prims.surface import soft_body_surfaces
from wsim.usd.result import provenance, sublayer
from wsim.usd.result.dependencies import describe_overwrite
from wsim.usd.result.kinds.places import unwritable_prims
from wsim.usd.result.kinds.rows import Sample, sample_attribute_values
from wsim.usd.result.partial import PartialFile, check_output, partial_path, refuse_control_characters
from wsim.usd.result.restart import RestartState, check_fields, copy_samples, is_whole_frame_code, store_restart_fields
from wsim.usd.result.samples import BodyWriter, ColliderWriter
from wsim.usd.stage import open_stage

Arrays = Mapping[str, np.ndarray]
FIELDS_SHARE = 4           # restart fields are rewritten when so many times their bytes of samples have come: a crate
                           # keeps what was overwritten, so they add at most a quarter to the file


def check_result(scene: Scene, path: str, restart: str | None = None) -> None:
    """Raises as `Recorder` does for an output that cannot be, before anything is written: ValueError, OSError.

    restart    the earlier result that the run goes on from; it may be replaced itself, what it lies over may not
    """
    path = check_output(path)
    if scene.source:
        refuse_control_characters(os.path.abspath(scene.source))
    for target in (path, partial_path(path)):
        if scene.source:
            sublayer.refuse_source(scene.source, target)
        if restart and describe_overwrite(target, restart) not in ("", "itself"):
            raise ValueError(f"{target} is a file that {restart} depends on, from which the run goes on. Choose another output")


class Recorder:
    """Records one run of `scene` into `path` (.usdc, .usda, .usd), as in `Recorder(scene, "out.usda")`, or
    `simulation.record("out.usda")`.

    flatten            one self-contained file instead of a layer over the source
    velocities         write them (motion blur, restart); False blocks those of the source
    normals            let authored normals follow; False blocks them, viewers then compute their own
    restart_fields     called after each whole frame: {body path: {name: array}} for an exact restart
    continues          the `RestartState` that the run went on from: its earlier samples come first
    settings           called at each save: precision, solver ... of the run, for who goes on from it

    A scene without a source file is written beside the result first (NAME_scene.usda). `notes` collects warnings.
    Raises SceneError where the scene cannot take a result, ValueError for an output that is the source or has no USD
    ending, OSError where it cannot be written.
    """

    def __init__(self, scene: Scene, path, *, flatten: bool = False, velocities: bool = True, normals: bool = True,
                 restart_fields: Callable[[], Mapping[str, Arrays]] | None = None, continues: RestartState | None = None,
                 settings: Callable[[], Mapping] = dict):
        self.scene, self.path, self.flatten = scene, check_output(path), flatten
        self.restart_fields, self.continues, self.settings = restart_fields, continues, settings
        self.notes: list[Problem] = []
        self.codes: list[float] = []          # time codes written, this run's and those it continues
        self.count, self.fields_code = 0, 0.0             # appends of this run
        self.clips = False                    # one file a frame, see `wsim.usd.clips`
        self.bytes_since_fields = math.inf    # of samples; the first save takes the fields along
        self.fields: Mapping[str, Arrays] = {}   # of the last whole frame
        self.made: str | None = None          # source written by this recorder
        self.result: str | None = None        # the finished file
        self.kept: str | None = None          # the unfinished one that stays
        check_result(scene, self.path, continues.path if continues else None)
        self.file, self.closed = PartialFile(self.path), False
        try:
            self._note_recovered()
            self._choose_source()
            self._open(velocities, normals)
        except BaseException:
            self._drop_result_files()
            raise

    # opening

    def _note_recovered(self) -> None:
        kept = self.file.recovered
        if kept:
            text = f"an earlier run did not end; its frames are in {kept} (view it, or go on from it with --restart)"
            self.notes.append(Problem(self.path, text, fatal=False))
            if self.continues and os.path.realpath(self.continues.path) == os.path.realpath(self.file.path):
                self.continues.path = kept

    def _choose_source(self) -> None:
        if self.scene.source:
            self.source = os.path.abspath(self.scene.source)
        else:
            self.source, new = sublayer.write_source(self.scene, self.path)
            self.made = self.source if new else None

    def _open(self, velocities: bool, normals: bool) -> None:
        layer = self.file.layer
        delegate = UsdUtils.CoalescingDiagnosticDelegate()     # the loader has reported what does not compose
        sublayer.set_source_sublayer(self.source, layer, os.path.dirname(self.path))
        self.stage: Any = Usd.Stage.Open(layer)
        delegate.TakeUncoalescedDiagnostics()
        self.stage.SetEditTarget(layer)
        sublayer.write_variant_selections(self.stage, self.scene.variants)
        if problems := unwritable_prims(self.stage, self.scene):
            raise SceneError(problems)
        self.rate = self.stage.GetTimeCodesPerSecond()
        self.bodies = {b.path: (self.stage.GetPrimAtPath(b.path), len(b.points)) for b in bodies_sampled_by_point(self.scene)}
        self.skins = embed_all_skins(self.scene)
        self.overs = {path: BodyWriter(self.stage.GetPrimAtPath(path), velocities=velocities, normals=normals, notes=self.notes)
                      for path in (*self.bodies, *self.skins)}
        if self.continues:
            self.codes += copy_samples(self.continues, self.stage, self.scene, self.file.beside)
        self.surfaces = soft_body_surfaces(self.scene, self.bodies, self.codes)
        self.colliders = {c.path: ColliderWriter(self.stage, self._open_source_stage, c, self.codes)
                          for c in self.scene.colliders}
        layer.startTimeCode = self.scene.start

    def _open_source_stage(self) -> Any:
        return open_stage(self.source, self.scene.variants)

    # writing

    def time_code(self, frame: float) -> float:
        """Time code of a frame, or of a place between two, counted from the scene's start."""
        return self.scene.start + frame * self.rate / self.scene.fps

    def append(self, time_code: float, positions: Arrays, velocities: Arrays | None = None,
               poses: Arrays | None = None, primvars: Mapping[str, Arrays] | None = None,
               reactions: Arrays | None = None, others: Sequence[Sample] = ()) -> None:
        """Writes one sample of every body and of its skins; saves after whole frames, as often as 5 % of the wall time allows.

        positions    {body path: (n, 3)} world [m], author's order      velocities   the same [m/s]
        poses        {collider path: (4, 4)} world [m]; written where they are not what the source says
        primvars     {body path: {name: (n,)}} [SI], author's order: see `wsim.usd.result.samples.PRIMVARS`
        reactions    {pin path: (k, 3)} [N], world: see `wsim.usd.prims.reactions`
        others       what else methods have, see `wsim.scene.samples`
        time_code    later than all before; any fraction (subframes), before the scene's start too (pre-roll). The first
                     one may repeat the last of the result that the run continues.
        Raises ValueError for arrays that do not fit, SceneError for a frame without inverse: nothing of the sample is
        kept then. OSError if the disk does not take it.
        """
        code = float(time_code)
        self._check(code, positions, velocities)
        whole = is_whole_frame_code(code, self.scene, self.rate)
        fields = self._checked_fields() if whole else {}
        samples: list[tuple] = []
        try:
            samples += self._body_sample_values(code, positions, velocities, primvars or {})
            samples += reaction_samples_of_pins(self.stage, reactions or {})
            samples += [pair for each in others for pair in sample_attribute_values(self.stage, each, code, self.file.beside)]
            for path in (poses or {}).keys() & self.colliders.keys():
                self.colliders[path].write(code, (code - self.scene.start) / self.rate, (poses or {})[path])
            for attribute, value in samples:
                attribute.Set(value, code)
        except BaseException:                  # Ctrl-C too: a sample is there whole or not at all
            for attribute, _ in samples:
                attribute.ClearAtTime(code)
            self.file.beside.undo()
            raise
        self.file.beside.keep()
        self.bytes_since_fields += sum(12 * len(value) if hasattr(value, "__len__") else 8 for _, value in samples)
        if code not in self.codes[-1:]:
            self.codes.append(code)
        self.count += 1
        if whole:
            self.fields, self.fields_code = fields, code
            if self.file.due():
                self._save(self.bytes_since_fields >= FIELDS_SHARE * _restart_byte_count(self.fields))

    def _body_sample_values(self, code: float, positions: Arrays, velocities: Arrays | None,
                            primvars: Mapping[str, Arrays]) -> list:
        """(attribute, value) of each sample of bodies and skins."""
        found = []
        for path, over in self.overs.items():
            own = over.sample(code, self._of(path, positions), self._of(path, velocities) if velocities else None)
            own += over.color(primvars.get(path, {}))
            found += own + (self.surfaces[path].of(own) if path in self.surfaces else [])
        return found

    def _of(self, path: str, values: Arrays) -> np.ndarray:
        """Values of a body, or those that a skin has from its body."""
        return self.skins[path].of(values[self.skins[path].body]) if path in self.skins else values[path]

    def _check(self, code: float, positions: Arrays, velocities: Arrays | None) -> None:
        if self.closed:
            raise OSError(f"{self.path} is closed; make a new Recorder")
        if not self.file.good:
            raise OSError(f"{self.path} could not be written before; close this Recorder")
        last = self.codes[-1] if self.codes else -np.inf
        if not np.isfinite(code) or code < last or (code == last and self.count):
            raise ValueError(f"time code {code:g} is not later than {last:g}, the last one written")
        for what, given in (("positions", positions), ("velocities", velocities)):
            if given is None:
                continue
            for path, (_, n) in self.bodies.items():
                if path not in given:
                    raise ValueError(f"{what} of {path} are missing; every body of the scene needs them")
                if np.shape(given[path]) != (n, 3) or not np.isfinite(given[path]).all():
                    raise ValueError(f"{what} of {path} must be finite with shape ({n}, 3); found shape "
                                     f"{np.shape(given[path])} at time code {code:g}")

    def _checked_fields(self) -> Mapping[str, Arrays]:
        found = self.restart_fields() if self.restart_fields else {}
        for path, fields in found.items():
            if not self.stage.GetPrimAtPath(path):
                raise ValueError(f"restart_fields names {path}, which is no prim; the bodies are {', '.join(self.bodies)}")
            check_fields(path, fields)
        return found

    def _save(self, with_fields: bool, last: bool = False) -> None:
        if with_fields:
            for path, fields in self.fields.items():
                store_restart_fields(self.stage.GetPrimAtPath(path), self.fields_code, fields,
                                     None if self.flatten else self.file.beside)
            self.bytes_since_fields = 0
        layer = self.file.layer
        self.file.beside.forget_empty(layer, last)
        provenance.write_provenance(layer, self.scene, self.settings())
        layer.startTimeCode = min(layer.startTimeCode, self.codes[0])
        layer.endTimeCode = self.codes[-1]
        self.file.save()

    def close(self, interrupted: bool = False) -> str | None:
        """Ends the file and gives it its name; returns that, or None where there is none.

        Without any frame no file stays. What was at the name before stays until the new result is whole: after a failure, and
        of a run that did not get to its end, the frames stay in the partial file (`kept`), beside it.
        interrupted    the run did not get to its end (Ctrl-C): noted in the layer as custom data `wsim:interrupted`
        Raises OSError if the disk does not take it; the frames saved so far then stay in the partial file.
        """
        if self.closed:
            return self.result
        if not self.count:
            self._drop_result_files()
            return None
        try:
            self.kept = self.file.path
            if self.file.good:
                self._finish_result_file(interrupted)
        finally:
            self._let_go()
            self.file.leave()
        return self.result

    def _finish_result_file(self, interrupted: bool) -> None:
        layer = self.file.layer
        if interrupted:
            layer.customLayerData = {**layer.customLayerData, "wsim:interrupted": True}
        self._save(with_fields=True, last=not interrupted)
        if interrupted:
            return
        flat = sublayer.flatten_stage(self.stage, os.path.dirname(self.path)) if self.flatten else None
        layer = None
        self._let_go()
        self.file.finish(flat, self.clips)
        self.result, self.kept = self.path, None
        if not self.scene.source:
            sublayer.remove_sources(self.path, None if self.flatten else self.source)

    def _let_go(self) -> None:
        """Releases stage and prims, so that the file can be renamed on every system."""
        self.overs, self.skins, self.surfaces, self.colliders, self.bodies = {}, {}, {}, {}, {}
        self.stage, self.closed = None, True

    def _drop_result_files(self) -> None:
        """Ends without a result: no file of this recorder stays, and that of an earlier run has its name again."""
        self._let_go()
        self.file.discard()
        self.kept = self.file.path if self.file.put_back else None
        if self.made:
            os.remove(self.made)

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind, error, trace) -> None:
        self.close(interrupted=kind is not None)


def _restart_byte_count(fields: Mapping[str, Arrays]) -> int:
    return sum(value.nbytes for group in fields.values() for value in group.values())
