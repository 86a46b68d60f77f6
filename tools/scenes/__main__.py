"""Writes the example scenes: python -m tools.scenes [FOLDER]"""

import sys
from pathlib import Path

from tools.scenes import SCENES

target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[2] / "scenes"
for name, write in SCENES.items():
    text = write()
    (target / f"{name}.usda").write_text(text)
    print(f"{name}.usda  {len(text) / 1000:.0f} kB")
