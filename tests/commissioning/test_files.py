"""Surveys and references as surveyors and their instruments deliver them."""

from __future__ import annotations

import json
import math
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_edge_agent.commissioning.errors import SurveyError, TruthError
from wonderland_edge_agent.commissioning.live.wizard import _place_of
from wonderland_edge_agent.commissioning.reference import load_track
from wonderland_edge_agent.commissioning.survey_files import Origin, globe_of, load_survey, local_of, parse_origin
from wonderland_edge_agent.references import PositionError
from wonderland_edge_agent.references.datagrams import position

ORIGIN = Origin(60.4503100, 22.2712400, 31.0)
PLACES = {"A1": (1.6, 1.6, 1.6), "A2": (-1.6, 1.6, 0.25), "A3": (-1.6, -1.6, 0.25), "A4": (1.6, -1.6, 0.25)}


def write(path, header, rows):
    path.write_text("\n".join([",".join(header), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


class TestSurveys:
    def test_local_coordinates(self, tmp_path):
        path = write(
            tmp_path / "a.csv",
            ("anchor", "x", "y", "z", "sigma", "mac"),
            [(n, *p, 0.004, f"0xA0{i:02x}") for i, (n, p) in enumerate(PLACES.items())],
        )
        survey = load_survey(path, origin=ORIGIN)
        assert survey.places_m == PLACES
        assert {(a.sigma_m, a.mac) for a in survey.anchors} == {(0.004, 0xA000 + i) for i in range(4)}
        assert survey.frame.lat_e7 == 604_503_100
        assert survey.notes == ()

    def test_positions_on_the_globe_are_tied_to_a_millimetre(self, tmp_path):
        globe = {name: globe_of(ORIGIN.frame, place) for name, place in PLACES.items()}
        path = write(
            tmp_path / "g.csv", ("anchor", "lat", "lon", "height"), [(n, *map(repr, p)) for n, p in globe.items()]
        )
        survey = load_survey(path, origin=ORIGIN)
        for name, place in survey.places_m.items():
            assert place == pytest.approx(PLACES[name], abs=1e-3)
        assert [code for code, _ in survey.notes] == ["sigma_assumed"]
        # Without an origin the anchors' middle is one.
        assert load_survey(path).frame.lat_e7 == pytest.approx(604_503_100, abs=5)

    def test_a_map_projection(self, tmp_path):
        from pyproj import Transformer

        to = Transformer.from_crs("EPSG:4326", "EPSG:3067", always_xy=True)
        rows = []
        for name, place in PLACES.items():
            lat, lon, height = globe_of(ORIGIN.frame, place)
            east, north = to.transform(lon, lat)
            rows.append((name, repr(east), repr(north), height))
        path = write(tmp_path / "p.csv", ("anchor", "x", "y", "z"), rows)
        survey = load_survey(path, origin=ORIGIN, crs="EPSG:3067")
        for name, place in survey.places_m.items():
            assert place == pytest.approx(PLACES[name], abs=2e-3)
        with pytest.raises(SurveyError, match="no projection"):
            load_survey(path, crs="EPSG:99999")

    def test_a_total_stations_own_frame_is_turned_onto_its_control_points(self, tmp_path):
        angle, shift = math.radians(37.0), (100.0, 200.0, 5.0)

        def station(place):
            x, y, z = place
            return (
                math.cos(angle) * x - math.sin(angle) * y + shift[0],
                math.sin(angle) * x + math.cos(angle) * y + shift[1],
                z + shift[2],
            )

        path = write(tmp_path / "s.csv", ("anchor", "x", "y", "z"), [(n, *station(p)) for n, p in PLACES.items()])
        known = [(10.0, 0.0, 0.0), (-8.0, 9.0, 0.4), (3.0, -12.0, 0.1)]
        rows = [(*station(p), *map(repr, globe_of(ORIGIN.frame, p))) for p in known]
        control = write(tmp_path / "c.csv", ("x", "y", "z", "lat", "lon", "height"), rows)
        survey = load_survey(path, origin=ORIGIN, control=control)
        for name, place in survey.places_m.items():
            assert place == pytest.approx(PLACES[name], abs=3e-3)
        rows[0] = (rows[0][0] + 1.0, *rows[0][1:])
        with pytest.raises(SurveyError, match="disagree"):
            load_survey(path, origin=ORIGIN, control=write(control, ("x", "y", "z", "lat", "lon", "height"), rows))
        with pytest.raises(SurveyError, match="at least 2"):
            load_survey(path, control=write(control, ("x", "y", "z", "lat", "lon", "height"), rows[:1]))
        with pytest.raises(SurveyError, match="exclude"):
            load_survey(path, crs="EPSG:3067", control=control)

    def test_toml(self, tmp_path):
        path = tmp_path / "survey.toml"
        path.write_text(
            "[origin]\nlat = 60.45031\nlon = 22.27124\nheight = 31.0\n"
            + "".join(f'[[anchors]]\nanchor_id = "{n}"\nx = {x}\ny = {y}\nz = {z}\nmac = {0xA001 + i}\nsigma = 0.003\n' for i, (n, (x, y, z)) in enumerate(PLACES.items()))
        )  # fmt: skip
        survey = load_survey(path)
        assert survey.places_m == PLACES
        assert survey.anchors[3].mac == 0xA004
        assert survey.frame.height_mm == 31_000

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"A2": PLACES["A1"]}, "at the same place"),
            ({"A2": (-1.6, 900.0, 0.2)}, "from the others"),
            ({"A2": ("x", 1, 2)}, "x is missing or no number"),
            ({"A2": ("nan", 1, 2)}, "x is nan"),
            ({"A3": None, "A4": None}, "at least 3"),
        ],
    )
    def test_surveys_that_cannot_be(self, tmp_path, change, said):
        rows = [(n, *p) for n, p in {**PLACES, **change}.items() if p is not None]
        with pytest.raises(SurveyError, match=said):
            load_survey(write(tmp_path / "a.csv", ("anchor", "x", "y", "z"), rows), origin=ORIGIN)

    @pytest.mark.parametrize(
        ("header", "row", "said"),
        [
            (("anchor", "x", "y", "z", "sigma"), ("B", 0, 5, 0, 0), "sigma"),
            (("anchor", "x", "y", "z", "sigma"), ("B", 0, 5, 0, 30), "sigma"),
            (("anchor", "x", "y", "z", "mac"), ("B", 0, 5, 0, "node"), "mac"),
            (("name", "x", "y", "z"), ("B", 0, 5, 0), "without a name"),
            (("anchor", "x", "y", "z"), ("C", 0, 5, 0), "there twice"),
        ],
    )
    def test_rows_that_cannot_be(self, tmp_path, header, row, said):
        rows = [("C", 0, 0, 1, 0.01), ("D", 3, 0, 0, 0.01), ("E", 3, 3, 0, 0.01)]
        if "mac" in header:
            rows = [(*each[:4], f"a00{i}") for i, each in enumerate(rows)]
        with pytest.raises(SurveyError, match=said):
            load_survey(write(tmp_path / "a.csv", header, [*(each[: len(header)] for each in rows), row]))

    @pytest.mark.parametrize("text", ["", "1,2", "a,b,c", "nan,1,2", "1,2,3,4"])
    def test_origins_that_are_none(self, text):
        with pytest.raises(SurveyError):
            parse_origin(text)
        with pytest.raises(SurveyError, match="no place on the globe"):
            parse_origin("120,0,0").frame  # noqa: B018

    @given(st.floats(-80, 80), st.floats(-180, 180), st.floats(-500, 500), st.floats(-500, 500), st.floats(-50, 200))
    @settings(max_examples=50, deadline=None)
    def test_there_and_back(self, lat, lon, east, north, up):
        frame = Origin(round(lat, 7), round(lon, 7), 100.0).frame
        place = globe_of(frame, (east, north, up))
        assert local_of(frame, place, "") == pytest.approx((east, north, up), abs=1e-4)


class TestReferences:
    def test_plain_in_the_pads_frame(self, tmp_path):
        track = load_track(
            write(tmp_path / "t.csv", ("t", "x", "y", "z", "more"), [(1.0, 1, 2, 3, "x"), (2.0, 3, 2, 3, "")])
        )
        assert track.at(1.5) == pytest.approx((2, 2, 3))

    def test_rtk_on_the_globe(self, tmp_path):
        rows = [(float(i), *map(repr, globe_of(ORIGIN.frame, (float(i), 2.0, 3.0)))) for i in range(4)]
        path = write(tmp_path / "r.csv", ("time", "latitude", "longitude", "altitude"), rows)
        assert load_track(path, ORIGIN.frame).at(2.5) == pytest.approx((2.5, 2.0, 3.0), abs=1e-3)
        with pytest.raises(TruthError, match="--origin"):
            load_track(path)

    def test_poses_of_ros_tools(self, tmp_path):
        names = (
            "%time",
            "field.header.stamp",
            "field.pose.position.x",
            "field.pose.position.y",
            "field.pose.position.z",
        )
        rows = [(1, 1_700_000_000_000_000_000 + i * 100_000_000, i, 0, 1) for i in range(3)]
        track = load_track(write(tmp_path / "p.csv", names, rows))
        assert track.t_s[1] - track.t_s[0] == pytest.approx(0.1, abs=1e-3)
        names = (
            "header.stamp.sec",
            "header.stamp.nanosec",
            "pose.pose.position.x",
            "pose.pose.position.y",
            "pose.pose.position.z",
        )
        rows = [(1_700_000_000, i * 100_000_000, i, 0, 1) for i in range(3)]
        assert load_track(write(tmp_path / "q.csv", names, rows)).at(1_700_000_000.15) == pytest.approx(
            (1.5, 0, 1), abs=1e-3
        )

    def test_an_export_of_motive(self, tmp_path):
        path = tmp_path / "take.csv"
        path.write_text(
            "Format Version,1.23,Take Name,one,Length Units,Millimeters\n"
            ",,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n"
            ",,drone,drone,drone,drone,drone,drone,drone\n"
            ",,1,1,1,1,1,1,1\n"
            ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position\n"
            "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z\n"
            "0,0.0,0,0,0,1,1000,1500,-2000\n"
            "1,0.1,,,,,,,\n"
            "2,0.2,0,0,0,1,3000,1500,-2000\n"
        )
        track = load_track(path)
        assert track.at(0.1) == pytest.approx((2.0, 2.0, 1.5))

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("", "no reference"),
            ("a,b\n1,2\n", "no reference"),
            ("t,x,y,z\n", "a track needs more"),
            ("t,x,y,z\n2,0,0,0\n1,0,0,0\n", "time goes backwards"),
            ("t,x,y,z\n1,0,zero,0\n2,0,0,0\n", "no numbers"),
        ],
    )
    def test_files_that_are_none(self, tmp_path, text, said):
        path = tmp_path / "t.csv"
        path.write_text(text)
        with pytest.raises(TruthError, match=said):
            load_track(path)

    def test_datagrams(self):
        frame = ORIGIN.frame
        assert position(b'{"x":1,"y":2,"z":3}', None, 7.0) == (7.0, (1.0, 2.0, 3.0))
        assert position(b'{"t":5,"x":1,"y":2,"z":3}', None, 7.0)[0] == 5.0
        pose = {"header": {}, "pose": {"position": {"x": 1, "y": 2, "z": 3}}}
        assert position(json.dumps(pose).encode(), None, 7.0)[1] == (1.0, 2.0, 3.0)
        lat, lon, height = globe_of(frame, (4.0, 5.0, 6.0))
        place = json.dumps({"lat": lat, "lon": lon, "height": height}).encode()
        assert position(place, partial(_place_of, frame), 7.0)[1] == pytest.approx((4, 5, 6), abs=1e-3)
        with pytest.raises(PositionError, match="--origin"):
            position(place, None, 7.0)

    @given(
        st.binary(max_size=64)
        | st.recursive(
            st.none() | st.booleans() | st.floats() | st.text(max_size=4),
            lambda c: (
                st.lists(c, max_size=3)
                | st.dictionaries(st.sampled_from(["x", "y", "z", "t", "lat", "lon", "height", "pose", "position"]), c)
            ),
            max_leaves=8,
        ).map(lambda v: json.dumps(v).encode())
    )
    @settings(max_examples=150, deadline=None)
    def test_any_datagram_is_a_position_or_a_typed_error(self, data):
        try:
            t_s, point = position(data, partial(_place_of, ORIGIN.frame), 7.0)
        except PositionError:
            return
        assert all(math.isfinite(value) for value in (t_s, *point))
