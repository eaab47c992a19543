"""Maps of the DR20's rooms: a ring for the outline and a tuple of rings for what stands in it, in metres."""


def box(x0, y0, x1, y1):
    """The ring of an axis-aligned rectangle, counter-clockwise from its lower left corner."""
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


#: The assignment's room, with its five tables.
ROOM = box(0.0, 0.0, 5.0, 5.0)
TABLES = (
    box(2.0, 2.0, 3.0, 3.5),
    box(2.0, 1.0, 2.5, 1.5),
    box(3.0, 1.0, 3.5, 1.5),
    box(1.0, 2.0, 1.5, 2.5),
    box(4.0, 4.0, 4.5, 4.5),
)

#: Two rooms and a corridor, joined by doors of 0.9 m; walls are 0.1 m thick.
FLAT = box(0.0, 0.0, 8.0, 5.0)
PARTITIONS = (
    box(0.0, 2.9, 1.2, 3.0),
    box(2.1, 2.9, 5.6, 3.0),
    box(6.5, 2.9, 8.0, 3.0),
    box(4.0, 3.0, 4.1, 5.0),
    box(2.0, 0.0, 2.6, 0.8),
    box(6.2, 1.2, 6.8, 1.8),
    box(0.0, 4.3, 0.7, 5.0),
    box(5.0, 4.5, 6.0, 5.0),
)

#: No right angle helps: slanted walls, a triangle and a hexagon.
ATTIC = ((0.0, 0.0), (5.5, 0.4), (6.2, 3.0), (4.4, 5.2), (1.2, 4.6), (-0.6, 2.4))
CHIMNEYS = (
    ((1.2, 1.4), (2.2, 1.6), (1.5, 2.4)),
    ((3.6, 2.2), (4.1, 2.1), (4.4, 2.5), (4.2, 3.0), (3.7, 3.1), (3.4, 2.7)),
)

#: Turned by half a turn it is itself: no scan tells one end from the other.
TWIN = box(0.0, 0.0, 6.0, 4.0)
TWIN_PILLARS = (box(1.0, 1.0, 1.8, 1.6), box(4.2, 2.4, 5.0, 3.0))
