"""A method that is no part of wsim: wheels that spin and slow down. One folder and one row (`ROW`), and it is loaded, checked,
planned, run, recorded, restarted and drawn as those of wsim are."""

from math import inf

from wsim.scene.methods import Row
from wsim.scene.values.value import Range, Value

ROW = Row("wheels", "tests.make.wheels", owns=("Wheel",), claims=("ToyWheelAPI",), without="there is no wheel")
VALUES = [Value("Wheel", "drag", "1/s", why="nothing is recorded of wheels"),
          *(Value("Wheel", name, unit, Range(-inf), live=False) for name, unit in (("angle", "rad"), ("rate", "rad/s")))]
