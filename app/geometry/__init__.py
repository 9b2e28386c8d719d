"""Numbers to numbers: frozen values, millimetres and radians, numpy only.

Camera frame: x right, y down, z out of the lens. Table frame: origin where the axis meets the table's
plane, z up along the axis, x towards the camera; it turns with the table, so a point of the object has
one place in it at every angle.
"""
