"""A method that is no part of wsim: sparks that fly, and hand every kind of sample to a result. One folder, one row (`ROW`)."""

from wsim.scene.methods import MethodRow

ROW = MethodRow("sparks", "tests.make.rows.sparks", owns=("Sparks",), claims=("ToySparksAPI",), without="there are no sparks")
