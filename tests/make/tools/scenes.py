"""Numbers of the example scenes that tests of two folders compare with."""

GRAINS = {"snowball": 2156, "jelly_cubes": 4896, "hourglass": 4216, "sand_castle": 5340,
          "sand_on_cloth": 464}                        # particles
CLUSTERS = {"jelly_clusters_on_cloth": (125, 216, 125)}      # points of each body
PARTICLES = {"sand_shovel": (2268,), "beads_in_bowl": (0, 0, 0), "two_waters": (2400,)}       # of each prim, at the start
