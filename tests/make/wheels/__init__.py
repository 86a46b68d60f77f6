"""A method that is no part of wsim: wheels that spin and slow down. One folder and one row (`ROW`), and it is loaded, checked,
planned, run, recorded, restarted and drawn as those of wsim are."""

from wsim.scene.methods import Row

ROW = Row("wheels", "tests.make.wheels", owns=("Wheel",), claims=("ToyWheelAPI",), without="there is no wheel")
