"""Maps of ROS: what is read, what is written, and what is said of files that are neither."""

import numpy as np
import pytest
from PIL import Image

from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.world import World
from course_lib.geometry.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from course_lib.recording import RecordingError
from course_lib.recording.ros_map import read_ros_map, write_ros_map

YAML = """image: map.pgm
resolution: 0.05
origin: [-1.0, 2.0, 0.5]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
#: Upper row of the image: occupied, unknown, free. Lower row: free, occupied, unknown.
LEVELS = [[0, 205, 254], [254, 0, 205]]
CELLS = [[FREE, OCCUPIED, UNKNOWN], [OCCUPIED, UNKNOWN, FREE]]
PLAIN = "P2\n# by hand\n3 2\n255\n0 205 254\n254 0 205\n"


def write(folder, image=PLAIN, text=YAML):
    (folder / "map.pgm").write_bytes(image if isinstance(image, bytes) else image.encode())
    (folder / "map.yaml").write_text(text)
    return folder / "map.yaml"


@pytest.mark.parametrize("image", [PLAIN, b"P5 3 2 255\n" + bytes(sum(LEVELS, []))])
def test_what_is_read(tmp_path, image):
    grid = read_ros_map(write(tmp_path, image))
    # The image's last row is the one with the lowest y.
    np.testing.assert_array_equal(grid.cells, CELLS)
    assert grid.resolution == 0.05 and grid.origin == (-1.0, 2.0, 0.5)


@pytest.mark.parametrize(
    "entries, levels, cells",
    [
        ("negate: 1", [0, 50, 255], [FREE, UNKNOWN, OCCUPIED]),
        ("negate: false", [0, 50, 255], [OCCUPIED, OCCUPIED, FREE]),
        ("mode: trinary", [0, 205, 255], [OCCUPIED, UNKNOWN, FREE]),
        ("mode: raw", [0, 100, 101], [FREE, OCCUPIED, UNKNOWN]),
        ("mode: raw\nnegate: 1", [50, 65, 66], [UNKNOWN, UNKNOWN, OCCUPIED]),
    ],
)
def test_what_pixels_mean(tmp_path, entries, levels, cells):
    changed = [name.partition(":")[0] for name in entries.splitlines()]
    text = "".join(line + "\n" for line in YAML.splitlines() if line.partition(":")[0] not in changed) + entries
    grid = read_ros_map(write(tmp_path, b"P5 3 1 255\n" + bytes(levels), text))
    np.testing.assert_array_equal(grid.cells, [cells])


@pytest.mark.parametrize("mode, clear", [("trinary", OCCUPIED), ("scale", UNKNOWN)])
def test_colours_are_averaged_and_transparent_pixels_unknown_in_mode_scale(tmp_path, mode, clear):
    pixels = np.array([[[0, 0, 0, 255], [0, 0, 0, 0], [255, 255, 240, 255], [255, 0, 0, 255]]], dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "map.png")
    path = write(tmp_path, text=YAML.replace("map.pgm", "map.png") + f"mode: {mode}\n")
    np.testing.assert_array_equal(read_ros_map(path).cells, [[OCCUPIED, clear, FREE, OCCUPIED]])


def test_what_is_written_is_read_again(tmp_path):
    cells = np.random.default_rng(5).integers(-1, 2, size=(7, 4))
    grid = OccupancyGrid(cells, 0.025, (-3.5, 1e-7, -0.25))
    write_ros_map(grid, tmp_path / "again.yaml")
    again = read_ros_map(tmp_path / "again.yaml")
    np.testing.assert_array_equal(again.cells, grid.cells)
    assert (again.resolution, again.origin) == (grid.resolution, grid.origin)
    with pytest.raises(ValueError, match="must end in .yaml"):
        write_ros_map(grid, tmp_path / "map.pgm")


def test_a_map_is_a_world(tmp_path):
    """A robot drives in it, and stays in its free cells."""
    levels = np.full((40, 50), 254, dtype=np.uint8)
    levels[[0, -1]], levels[:, [0, -1]], levels[15:25, 20:22] = 0, 0, 0
    levels[:8, :8] = 205
    grid = read_ros_map(write(tmp_path, b"P5 50 40 255\n" + levels.tobytes()))
    room, *obstacles = grid.rings(FREE)
    assert len(room) == 6 and len(obstacles) == 1
    constants = Constants(room=room, obstacles=tuple(obstacles), radius=0.1)
    truth = World(constants, Hidden()).simulate(np.random.default_rng(4)).truth
    assert np.ptp(truth[:, :2]) > 0.3
    assert (grid.look_up(grid.cells, truth[:, :2], UNKNOWN) == FREE).all()


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("origin: [-1.0, 2.0, 0.5]\n", "", "lacks origin"),
        ("image: map.pgm", "image: gone.pgm", "gone.pgm cannot be read"),
        ("image: map.pgm", "image: [map.pgm]", "image must be the name of a file"),
        ("0.05", "-0.05", "resolution must be positive"),
        ("0.05", "small", "resolution must be a finite number, not 'small'"),
        ("[-1.0, 2.0, 0.5]", "[-1.0, 2.0]", "origin must be [x, y, yaw]"),
        ("[-1.0, 2.0, 0.5]", "[-1.0, 2.0, .inf]", "origin must be a finite number"),
        ("negate: 0", "negate: 2", "negate must be 0 or 1"),
        ("negate: 0", "negate: 0\nmode: costs", "mode 'costs' is not supported: make it one of trinary, scale, raw"),
        ("free_thresh: 0.196", "free_thresh: 0.7", "the first not above the second"),
        ("negate: 0", "negate: [0", "line 5: not YAML"),
        (YAML, "- a list", "holds no entries"),
    ],
)
def test_what_is_wrong_with_the_entries_is_said_in_one_line(tmp_path, old, new, message):
    path = write(tmp_path, text=YAML.replace(old, new))
    with pytest.raises(RecordingError) as caught:
        read_ros_map(path)
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("image", ["nothing", "P2 3 2 255\n0 205", "P2 3 2 255\n0 205 x 1 1 1", b"P5 3 2 255\n\x00"])
def test_images_that_cannot_be_read(tmp_path, image):
    with pytest.raises(RecordingError, match=r"map\.pgm cannot be read .*: save it again"):
        read_ros_map(write(tmp_path, image))


def test_images_of_sixteen_bits_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="not supported: save 8 bits"):
        read_ros_map(write(tmp_path, b"P5 1 1 65535\n\x00\x00"))


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(RecordingError, match=r"gone\.yaml cannot be read"):
        read_ros_map(tmp_path / "gone.yaml")
