"""What tests/tools/test_readme.py shares with other tests: FOLDERS."""


FOLDERS = ("scenes", "scenes/examples", "tools", "tools/results", "wsim/fitting", "wsim/gradient", "wsim/physics", "wsim/sweep")
