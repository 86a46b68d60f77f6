"""A method that is no part of wsim: wheels that spin and slow down. One folder and one row (`ROW`), and it is loaded, checked,
planned, run, recorded, restarted and drawn as those of wsim are."""

from math import inf

from wsim.scene.methods import MethodRow
from wsim.scene.values.value import ValueRange, ValueRow

ROW = MethodRow("wheels", "tests.make.rows.wheels", owns=("Wheel",), claims=("ToyWheelAPI",), without="there is no wheel")
VALUES = [ValueRow("Wheel", "drag", "1/s", why="nothing is recorded of wheels"),
          *(ValueRow("Wheel", name, unit, ValueRange(-inf), live=False)
            for name, unit in (("angle", "rad"), ("rate", "rad/s")))]
