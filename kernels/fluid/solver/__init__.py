"""Solves of the pressure of fluids: multigrid, fast diagonalisation, sealed regions."""
