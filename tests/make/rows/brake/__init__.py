"""A value that is no part of wsim: the grip of a brake, which slows the points of a body. One row (`VALUE`), and its use in one
file (`method`): it is set live, judged, varied, saved, fitted and refused as those of wsim are. `ROW` is that of the method."""

from wsim.scene.methods import MethodRow
from wsim.scene.values.value import ThetaMap, UsdAttribute, ValueRange, ValueRow

ROW = MethodRow("brake", "tests.make.rows.brake", owns=("Brake",), claims=("ToyBrakeAPI",), without="there is no brake",
                gradients=True)
VALUE = ValueRow("Brake", "grip", "1/s", ValueRange(high=50.0), varies=True, needs=("start",), fit=ThetaMap("log"),
                 usd=UsdAttribute("ToyBrakeAPI", "toy:grip"), why="a toy has none")
