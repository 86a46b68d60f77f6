"""Runs the converters of robots, mujoco-usd-converter and urdf-usd-converter of the Newton project, and sorts what they say.

They bring an OpenUSD that conflicts with usd-core, so they need an environment of their own: the folder WSIM_ROBOTS, else
~/.cache/wsim/robots.
"""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from wsim.scene import Problem, SceneError

PACKAGES = {".xml": "mujoco-usd-converter", ".urdf": "urdf-usd-converter"}
MADE = "wsim_robot.txt"         # says that a folder is one of these, which may be replaced
WARNING = re.compile(r"\[Warning\] \[[\w.]+\] (.*)")
ERROR = re.compile(r"^.*(?:Conversion failed: |Python runtime error: |\bValueError: )")
QUIET = ("texture", "material", "cameras", "lights", "display", "sensors")       # of looks, not of motion


def find_converter(package: str) -> Path:
    """The converter's command. Raises SceneError that says how to get it."""
    place = Path(os.environ.get("WSIM_ROBOTS") or Path("~/.cache/wsim/robots").expanduser())
    scripts, command = place / ("Scripts" if os.name == "nt" else "bin"), package.replace("-", "_")
    found = shutil.which(command, path=str(scripts)) or shutil.which(command)
    if found is None:
        raise SceneError(Problem(package, f"is not installed; it needs an environment of its own: python3 -m venv {place} && "
                                 f"{scripts / 'pip'} install {' '.join(PACKAGES.values())}"))
    return Path(found)


def failure_reason(said: list[str]) -> str:
    """Why a program failed, in a line: what it says from its last error on, without the names of its own modules."""
    first = max((k for k, line in enumerate(said) if ERROR.search(line)), default=len(said) - 1)
    text = ERROR.sub("", " ".join(said[max(first, 0):])).strip()
    return (text.removesuffix("'") if text.count("'") % 2 else text)[:200] or "no reason"


def run_converter(command: list, file: str, program: str) -> list[str]:
    """Lines that a program says. Raises SceneError with the reason of one that fails."""
    clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME", "PXR_PLUGINPATH_NAME")}
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, env=clean, check=False)
    said = [line.strip() for line in (done.stdout + "\n" + done.stderr).splitlines() if line.strip()]
    if done.returncode:
        raise SceneError(Problem(file, f"{program} refuses it: {failure_reason(said)}"))
    return said


def convert_robot(tool: Path, file: str, folder: Path, notes: list[Problem]) -> Path:
    """The USD file that a converter makes, in a folder of its own: one that was made here before is replaced, no other."""
    if folder.exists() and not (folder / MADE).is_file():
        raise SceneError(Problem(str(folder), "is there already, and not by this command; the converted robot goes here: "
                                 "move it away, or choose another name for the scene"))
    with tempfile.TemporaryDirectory(dir=folder.parent) as made:
        said = run_converter([tool, "--no-layer-structure", file, made], file, tool.name)
        results = sorted(Path(made).glob("*.usd*"))
        if len(results) != 1:
            raise SceneError(Problem(file, f"{tool.name} made {len(results)} USD files of it; expected: one"))
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(made, folder)
        (folder / MADE).write_text(f"made by wsim new robot of {os.path.basename(file)}\n", encoding="utf-8")
        notes += converter_warnings(said, file)
        return folder / results[0].name


def converter_warnings(said: list[str], file: str) -> list[Problem]:
    """What a converter warns of: shapes that it left out, in a line; other things, a line each. Looks are not told."""
    told = [re.sub(r"\S*[/\\]", "", match[1]) for line in said if (match := WARNING.search(line))]
    told = [text for text in told if not any(word in text.lower() for word in QUIET)]
    shapes = [text for text in told if "mesh" in text.lower() or "geom type" in text or "could not be parsed" in text]
    others = list(dict.fromkeys(text for text in told if text not in shapes))
    found = [Problem(file, f"the converter says: {text[:200]}", fatal=False) for text in others]
    if shapes:
        more = f" (and {len(shapes) - 1} more)" * (len(shapes) > 1)
        found.insert(0, Problem(file, f"shapes are left out: {shapes[0][:110]}{more}; nothing touches them; fix: give the "
                                "files of meshes, or take boxes, balls, capsules and cylinders", fatal=False))
    return found
