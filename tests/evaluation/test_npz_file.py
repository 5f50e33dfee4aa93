"""Arrays of .npz files: what was written comes back, all else is one line that names the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpvo.errors import InputError
from gpvo.mapping.scene_file import read_scene, write_scene
from gpvo.npz_file import read_npz

BOXES = np.arange(12.0).reshape(2, 2, 3)


def test_sizes_of_one_name_are_the_same(tmp_path: Path) -> None:
    path = tmp_path / "some.npz"
    np.savez(path, one=np.zeros((3, 2)), other=np.zeros(3), further=np.zeros(4))
    assert set(read_npz(path, "it", {"one": ("N", 2), "other": ("N",)})) == {"one", "other"}
    with pytest.raises(InputError, match=r"some\.npz: is not it \(further is float64 of shape"):
        read_npz(path, "it", {"other": ("N",), "further": ("N",)})


def test_an_optional_array_may_be_missing(tmp_path: Path) -> None:
    path = tmp_path / "some.npz"
    np.savez(path, one=1.0)
    assert list(read_npz(path, "it", {"one": (), "other": ()}, optional=["other"])) == ["one"]
    with pytest.raises(InputError, match="other"):
        read_npz(path, "it", {"one": (), "other": ()})


def test_a_bare_array_is_no_archive(tmp_path: Path) -> None:
    np.save(tmp_path / "scene.npy", BOXES)
    with pytest.raises(InputError, match=r"scene\.npy: is not a scene"):
        read_scene(tmp_path / "scene.npy")


@pytest.mark.parametrize("value", [0, 255])
def test_damage_is_read_or_named(tmp_path: Path, value: int) -> None:
    """Every byte is damaged in turn: of the archive, of its directory, of the array's header."""
    path = tmp_path / "scene.npz"
    write_scene(path, BOXES)
    whole = path.read_bytes()
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([value]) + whole[place + 1 :])
        try:
            assert read_scene(path).shape[1:] == (2, 3)
        except InputError as error:
            assert str(error).startswith(f"{path}: is not a scene") and "\n" not in str(error)
