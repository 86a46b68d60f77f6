"""The growing file of a run: what a kill, a full disk or an unfinished save leaves of it."""

import os
import signal
from pathlib import Path

import numpy as np
from pxr import Sdf, Vt

from tests.make.usd.result.partial import run
from tests.make.usd.result.recorder import CLOTH, EPS, author, record, world
from wsim.usd.result import crate, partial
from wsim.usd.result.restart import ResultReader, load_restart


def test_a_killed_run_leaves_its_frames_and_the_next_one_says_where(tmp_path):
    scene = author(tmp_path / "s.usda")
    process = run("""
        partial.SHARE = 1.0
        fields = lambda: {CLOTH: {"x": np.ones(100_000)}}
        recorder = Recorder(author(sys.argv[1] + "/t.usda"), sys.argv[1] + "/out.usdc", restart_fields=fields)
        for f in range(100000):
            recorder.append(1.0 + f, *world(frame=f % 7))
            if f == 20:
                print("ready", flush=True)
        """, tmp_path)
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "out.usdc").exists()
    recorder = record(scene, tmp_path / "out.usdc")
    kept = tmp_path / "out.recovered.usdc"
    assert str(kept) in str(recorder.notes[0])
    codes = ResultReader(kept).time_codes(CLOTH)
    assert len(codes) >= 21 and codes == [1.0 + f for f in range(len(codes))]
    restart = load_restart(kept, scene)              # fields this large come with the first save and then not for long
    assert restart.exact and restart.frame == 0
    last = world(frame=(len(codes) - 1) % 7)[0][CLOTH]
    assert np.abs(ResultReader(kept).positions(CLOTH, codes[-1]) - last).max() < 2 * EPS


def test_a_save_writes_nothing_but_the_index_and_what_is_new_and_is_undone_to_the_byte(tmp_path):
    """And a reader sees what was there before that save, and writes nothing."""
    file = partial.PartialFile(str(tmp_path / "out.usdc"))
    path, index = Path(file.path), Path(file.path + ".index")
    attribute = Sdf.AttributeSpec(Sdf.CreatePrimInLayer(file.layer, "/a"), "points", Sdf.ValueTypeNames.Point3fArray)
    for f in range(4):
        file.layer.SetTimeSample(attribute.path, f, Vt.Vec3fArray.FromNumpy(np.full((50, 3), f, np.float32)))
        before = path.read_bytes()
        with open(path, "rb") as opened:
            start = crate.CrateIndex.of(opened).start
        crate.copy_crate_index(file.path)
        file.layer.Save()                                  # a save that ends, but whose end was not noted: as if killed
        whole, kept = path.read_bytes(), index.read_bytes()
        assert whole[crate.HEADER:start] == before[crate.HEADER:start]
        for now in (whole, whole[:start] + bytes(len(whole) - start), whole[:start + 9]):     # killed where?
            path.write_bytes(now)
            index.write_bytes(kept)
            seen = crate.read_crate_layer(path)
            assert seen.ListTimeSamplesForPath("/a.points") == [float(k) for k in range(f)] if f else not seen.rootPrims
            assert (path.read_bytes(), index.read_bytes()) == (now, kept)
            assert crate.undo_unfinished_save(file.path) and path.read_bytes() == before
        path.write_bytes(whole)
        seen = crate.read_crate_layer(path)                # its writer lives: there is its lock
        assert seen.QueryTimeSample("/a.points", f)[49] == (f, f, f)
    file.discard()
    assert os.listdir(tmp_path) == []


def test_a_full_disk_is_one_message_and_the_frames_before_it_stay(tmp_path):
    process = run("""
        partial.SHARE = 1.0
        recorder = Recorder(author(sys.argv[1] + "/s.usda", mesh=lambda: triangles(40)), sys.argv[1] + "/out.usdc")
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))
        try:
            with recorder:
                for f in range(100):
                    recorder.append(1.0 + f, *world(1600, frame=f))
        except OSError as error:
            print(error)
        """, tmp_path)
    told = process.communicate()[0]
    assert "out.partial.usdc could not be written: File too large; the frames saved so far are in that file" in told
    assert sorted(os.listdir(tmp_path)) == ["out.partial.usdc", "s.usda"]
    result = ResultReader(tmp_path / "out.partial.usdc")
    assert result.time_codes(CLOTH) == [1.0 + f for f in range(10)]            # 38.4 kB of samples a frame in 400 kB
    assert np.abs(result.positions(CLOTH, 10.0) - world(1600, 9)[0][CLOTH]).max() < 2 * EPS
