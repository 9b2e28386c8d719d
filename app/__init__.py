"""Turnscan: a line laser, a camera and a turntable become a 3D scanner."""
