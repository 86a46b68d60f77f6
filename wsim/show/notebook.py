"""Scenes and simulations as notebooks show them: their `repr` and a small picture of the frame that they are at."""

from base64 import b64encode
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from wsim.show.picture import picture
from wsim.usd.write import save

SIZE = 400, 225


def describe_html(thing: Any) -> str:
    """HTML of a Scene or a Simulation. Without a picture where none can be drawn: then a note says why."""
    try:
        drawn = b64encode(draw_state(thing)).decode()
        image = f'<img src="data:image/png;base64,{drawn}" width="{SIZE[0]}" height="{SIZE[1]}" alt="the frame now"/>'
    except Exception as error:                                   # a notebook shows what it can of any object
        image = f"<small>no picture: {escape(str(error))}</small>"
    return f"<div>{image}<pre>{escape(repr(thing))}</pre></div>"


def draw_state(thing: Any) -> bytes:
    """A PNG file of a scene where it starts, or of a simulation at its frame."""
    with TemporaryDirectory(prefix="wsim_") as folder:
        stage, out = Path(folder, "now.usda"), Path(folder, "now.png")
        if hasattr(thing, "record"):
            with thing.record(stage):
                pass
        else:
            save(thing, stage)
        picture(stage, out, size=SIZE, device=getattr(thing, "device", None))
        return out.read_bytes()
