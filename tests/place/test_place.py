"""From an extract to an archive: what is in it, and what does not become one."""

from __future__ import annotations

import errno
import gzip
import os
import signal
import subprocess
import sys
import tarfile
import time

import pytest
import shapely

from wonderland_backend.maps.archive import Archive
from wonderland_simulator.place import fetch, making, osm
from wonderland_simulator.place.archive import tile_id
from wonderland_simulator.place.build import LEADS, WINDOW, build
from wonderland_simulator.place.layers import features_of
from wonderland_simulator.place.shore import shore
from wonderland_simulator.place.vector_tiles import Feature, Plane, cut


def test_an_extract_is_read(town):
    extract = osm.read(town.pbf())
    assert len(extract.ways) == 5
    assert extract.ways[2].tags == {"highway": "residential", "name": "Rue des Essais"}
    lon, lat = extract.line(extract.ways[2])[0]
    assert (round(lon, 7), round(lat, 7)) == (7.415, 43.73)
    assert list(extract.marked.values()) == [{"natural": "tree"}]


@pytest.mark.parametrize(
    "spoil", [lambda data: data[:-20], lambda data: b"<osm/>" * 9, lambda data: data[:60] + b"\xff" * 40]
)
def test_a_damaged_extract_is_said_to_be_one(town, spoil):
    with pytest.raises(osm.ExtractError):
        osm.read(spoil(town.pbf()))


def test_heights_say_how_they_are_known(town):
    contents = features_of(osm.read(town.pbf()), Plane(43.73))
    heights = {
        each.properties["height_source"]: each.properties["height"]
        for each in contents.features
        if each.layer == "buildings"
    }
    assert heights["measured"] == 21.0
    assert heights["storeys"] == pytest.approx(16.8)
    assert heights["guessed"] > 3
    assert contents.heights == {"measured": 1, "storeys": 1, "guessed": 1}


def test_the_sea_is_on_the_coasts_right(town):
    plane = Plane(43.73)
    west, north = plane.at(WINDOW[0], WINDOW[3])
    east, south = plane.at(WINDOW[2], WINDOW[1])
    sea = shore(osm.read(town.pbf()), plane, shapely.box(west, north, east, south), LEADS)
    assert sea.contains(shapely.Point(plane.at(7.4400, 43.7250)))
    assert not sea.intersects(shapely.Point(plane.at(7.4150, 43.7350)))


def test_the_archive_is_one_that_the_backend_serves_and_the_same_each_time(town, tmp_path):
    source = tmp_path / "town.osm.pbf"
    source.write_bytes(town.pbf())
    first, again = tmp_path / "a.pmtiles", tmp_path / "b.pmtiles"
    built = build(source, first)
    build(source, again)
    assert first.read_bytes() == again.read_bytes()
    assert built.features["buildings"] == 3
    description = Archive(first, vector=True).describe()
    assert description.kind == "vector"
    assert {"earth", "water", "roads", "buildings", "fade"} <= set(description.layers)
    assert description.attribution[0].text == "© OpenStreetMap contributors"
    assert description.attribution[0].href == "https://www.openstreetmap.org/copyright"
    assert (description.min_zoom, description.max_zoom) == (11, 15)


def test_a_tile_has_the_features_of_its_square_alone():
    plane = Plane(0.0)
    at = plane.at(10.0, 5.0)
    tiles = cut(
        [Feature("pois", shapely.Point(at), {"kind": "harbour", "name": "Tässä"}, 3)],
        plane,
        range(2, 5),
        shapely.box(0, 0, plane.size_m - 1, plane.size_m - 1),
    )
    assert sorted(tiles) == [(3, 4, 3), (4, 8, 7)]
    assert "Tässä".encode() in gzip.decompress(tiles[3, 4, 3])


def test_tiles_are_numbered_along_the_curve():
    # The specification's own examples.
    assert [tile_id(tile) for tile in ((0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0), (2, 0, 0))] == [
        0,
        1,
        2,
        3,
        4,
        5,
    ]


def test_a_package_without_the_extract_is_refused(tmp_path):
    package = tmp_path / "package.tar.gz"
    with tarfile.open(package, "w:gz") as bundle:
        other = tmp_path / "other"
        other.write_text("x")
        bundle.add(other, "other")
    with pytest.raises(fetch.FetchError, match="cannot be read"):
        fetch._taken(package, tmp_path)


def test_another_extract_than_the_checked_one_is_refused(tmp_path):
    package = tmp_path / "package.tar.gz"
    other = tmp_path / "other"
    other.write_text("x")
    with tarfile.open(package, "w:gz") as bundle:
        bundle.add(other, fetch.MEMBER)
    with pytest.raises(fetch.FetchError, match="not the one that was checked"):
        fetch._taken(package, tmp_path)


def test_without_a_network_the_place_says_why(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.setenv("PIP_NO_CACHE_DIR", "1")
    with pytest.raises(making.PlaceError, match="pip did not fetch"):
        making.make()
    assert not making.archive_path().exists()


def test_the_place_is_made_once_and_kept(town, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    source = tmp_path / "town.osm.pbf"
    source.write_bytes(town.pbf())
    made = making.make(source)
    before = made.stat().st_mtime_ns
    assert making.make() == made
    assert made.stat().st_mtime_ns == before


@pytest.fixture
def cached(town, tmp_path, monkeypatch):
    """The cache in a directory of the test's own, the package index away; an extract to make the place of."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.setenv("PIP_NO_CACHE_DIR", "1")
    source = tmp_path / "town.osm.pbf"
    source.write_bytes(town.pbf())
    monkeypatch.setattr(making, "extract_into", lambda _directory: source)
    return source


@pytest.mark.parametrize("left", [lambda data: data[:-40], lambda _: b"", lambda _: b"<html>" * 50])
def test_what_an_interrupted_making_left_is_made_anew(cached, left):
    made = making.make()
    whole = made.read_bytes()
    made.write_bytes(left(whole))
    partial = made.parent / f".{made.name}.half"
    partial.write_bytes(whole[:50])
    assert making.make() == made
    assert made.read_bytes() == whole
    assert not partial.exists()


def test_a_full_disk_is_said_in_one_line_and_leaves_nothing(cached, monkeypatch):
    def full(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(making.PlaceError, match="No space left") as error:
            making.make()
    assert "\n" not in str(error.value)
    assert [each.name for each in making.cache_directory().iterdir()] == [".lock"]
    assert making.make().is_file()


def run(**more):
    command = [sys.executable, "-m", "wonderland_simulator.place"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)


def test_a_cache_that_cannot_be_written_is_said_in_one_line(tmp_path):
    (tmp_path / "cache").write_text("a file stands where the directory should")
    making_it = run(env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")})
    out, said = making_it.communicate(timeout=60)
    assert (making_it.returncode, out, len(said.splitlines())) == (1, "", 1)
    assert "Not a directory" in said


def test_two_set_ups_at_once_make_it_one_after_the_other(cached):
    """The second waits for the first, finds its archive and asks no index for anything."""
    cache = making.cache_directory()
    cache.mkdir(parents=True)
    whole = making.make(cached).read_bytes()
    making.archive_path().unlink()
    with (cache / ".lock").open("w") as lock:
        making.fcntl.flock(lock, making.fcntl.LOCK_EX)
        second = run()
        time.sleep(2)
        assert second.poll() is None
        making.archive_path().write_bytes(whole)
    assert second.wait(60) == 0, second.stderr.read()
    second.communicate()
    assert making.archive_path().read_bytes() == whole


def test_one_that_is_killed_holds_nobody_up(cached):
    cache = making.cache_directory()
    cache.mkdir(parents=True)
    held = "import fcntl, sys, time; f = open(sys.argv[1], 'w'); fcntl.flock(f, fcntl.LOCK_EX); print(flush=True); time.sleep(60)"
    first = subprocess.Popen([sys.executable, "-c", held, str(cache / ".lock")], stdout=subprocess.PIPE)
    first.stdout.readline()
    first.send_signal(signal.SIGKILL)
    first.communicate()
    assert making.make().is_file()
