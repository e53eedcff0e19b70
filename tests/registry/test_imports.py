"""CSV files as offices write them, and as nobody should: read, checked line by line, nothing changed."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wonderland.proofs.records.transactions import RegisterUav
from wonderland.registry.lists import KINDS, MAX_ROWS, ListError, check

DRONES = KINDS["drones"]
GOOD = "uav_id,model,operator_id,registration\nOH-1,Falcon,arctic-air,FIN87\nOH-2,Crane Ä,arctic-air,\n"


@pytest.mark.parametrize(
    ("data", "encoding"),
    [
        (GOOD.encode(), "UTF-8"),
        (GOOD.encode("utf-8-sig"), "UTF-8"),
        (GOOD.encode("utf-16"), "UTF-16"),
        (GOOD.encode("cp1252"), "Windows-1252"),
        (GOOD.replace(",", ";").encode(), "UTF-8"),
        (GOOD.replace(",", "\t").replace("\n", "\r\n").encode(), "UTF-8"),
        ((GOOD + "\n,,,\n").encode(), "UTF-8"),
    ],
)
def test_what_offices_write_is_read(data, encoding):
    found = check(DRONES, data)
    assert (found.errors, found.encoding) == ([], encoding)
    assert [row["line"] for row in found.rows] == [2, 3]
    assert found.rows[1]["argument"]["model"] == "Crane Ä"
    for row in found.rows:
        RegisterUav.parse(row["argument"])


def test_every_error_has_its_line_and_column():
    text = (
        "uav_id,model,operator_id,registration\n"
        "OH 1,,arctic air,FIN_87\n"
        "OH-2,Falcon,arctic-air\n"
        "OH-3,Falcon,arctic-air,FIN87\n"
        "OH-3,Falcon,arctic-air,FIN87\n"
        f"OH-4,{'x' * 121},arctic-air,FIN87\n"
    )
    found = check(DRONES, text.encode())
    assert [(each["line"], each["column"]) for each in found.shown_errors("en")] == [
        (2, "model"),
        (3, ""),
        (5, "uav_id"),
        (6, "model"),
    ]
    assert "line 4" in str(found.errors[2].message)
    assert [row["line"] for row in found.rows] == [4]


def test_an_operators_secret_checks_the_number_and_goes_no_further():
    found = check(
        DRONES,
        b"uav_id,model,operator_id,registration\n"
        b"OH-1,m,o,FIN87astrdge12k8-xyz\nOH-2,m,o,fin87ASTRDGE12K8-XYZ\nOH-3,m,o,FIN87astrdge12k8\n"
        b"OH-4,m,o,FIN87astrdge12k8-xya\nOH-5,m,o,FIN87astrdge12k8-x\n",
    )
    assert [row["registration"] for row in found.rows] == 3 * ["FIN87astrdge12k8"]
    assert [(each["line"], each["column"]) for each in found.shown_errors("en")] == [
        (5, "registration"),
        (6, "registration"),
    ]
    assert all(
        "check character" in each["message"] and "xy" not in each["message"] for each in found.shown_errors("en")
    )


def test_all_that_is_wrong_with_one_line_is_named():
    found = check(DRONES, b"uav_id,model,operator_id,registration\nOH 1,m,arctic air,FIN_87\n")
    assert sorted(each["column"] for each in found.shown_errors("en")) == ["operator_id", "registration", "uav_id"]


def test_units_of_people_become_those_of_records():
    text = 'pad_id,name,operator_id,latitude,longitude,height_m,note\np1,Kupittaa,city,60.4518,"22,2666",20.5,\n'
    (row,) = check(KINDS["pads"], text.encode()).rows
    assert row["argument"] == {
        "pad_id": "p1",
        "name": "Kupittaa",
        "operator_id": "city",
        "lat_e7": 604_518_000,
        "lon_e7": 222_666_000,
        "height_mm": 20_500,
    }
    text = "uav_id,authorisation_id,pad_id,actions,valid_from,valid_until\nu,a,*,land|takeoff,2026-01-01,2026-12-31T12:00+02:00\n"
    (row,) = check(KINDS["authorisations"], text.encode()).rows
    assert row["argument"]["actions"] == ["land", "takeoff"]
    assert (row["argument"]["valid_from_ms"], row["argument"]["valid_until_ms"]) == (
        1_767_225_600_000,
        1_798_711_200_000,
    )


@pytest.mark.parametrize(
    ("cells", "column"),
    [
        ("p1,n,c,north,22,0,", "latitude"),
        ("p1,n,c,91,22,0,", "latitude"),
        ("p1,n,c,nan,22,0,", "latitude"),
        ("p1,n,c,60,22,1e400,", "height_m"),
        ('p1,n,c,60,22,0,"a\nb"', "note"),
    ],
)
def test_cells_that_are_no_values(cells, column):
    header = "pad_id,name,operator_id,latitude,longitude,height_m,note\n"
    (error,) = check(KINDS["pads"], (header + cells + "\n").encode()).shown_errors("en")
    assert error["column"] == column


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "first line"),
        (b"\n\n", "first line"),
        (b"a,b\n1,2\n", "missing: uav_id"),
        (b"uav_id,model,operator_id,registration,colour\n", "unknown: colour"),
        (b"uav_id,uav_id,model,operator_id,registration\n", "twice: uav_id"),
        (GOOD.encode("utf-16-le"), "Save it as CSV"),
        (b"PK\x03\x04\x00\x00", "Save it as CSV"),
        (b"\xff\xfe\x00", "no text in utf-16"),
        (b"\x81\x8d\n", "no text in cp1252"),
    ],
)
def test_what_is_no_list_is_refused(data, says):
    with pytest.raises(ListError) as refused:
        check(DRONES, data)
    assert says in str(refused.value)


def test_too_many_lines_are_refused():
    lines = "".join(f"OH-{i},m,o,\n" for i in range(MAX_ROWS + 1))
    with pytest.raises(ListError):
        check(DRONES, f"uav_id,model,operator_id,registration\n{lines}".encode())


def test_a_quote_that_never_ends_is_said_once():
    found = check(DRONES, b'uav_id,model,operator_id,registration\nOH-1,"Falcon,o,\nOH-2,m,o,\n')
    assert found.rows == []
    assert len(found.errors) == 1


@given(st.binary(max_size=400))
def test_any_bytes_at_all(data):
    for kind in KINDS.values():
        with contextlib.suppress(ListError):
            check(kind, data)


@given(st.lists(st.lists(st.text(max_size=12), min_size=1, max_size=8), max_size=6))
def test_any_cells_at_all(rows):
    for kind in KINDS.values():
        header = ",".join(kind.columns)
        body = "\n".join(",".join('"' + cell.replace('"', '""') + '"' for cell in row) for row in rows)
        found = check(kind, f"{header}\n{body}".encode("utf-8", "surrogatepass").replace(b"\x00", b""))
        for row in found.rows:
            kind.argument.parse(row["argument"])


def test_by_rest_what_exists_is_left_out(house):
    frida = house.person("Frida", "fleet_operator")
    text = "uav_id,model,operator_id,registration\nOH-DRN-0417,m,o,\nNEW-1,m,o,\nBAD 1,m,o,\n"
    answer = frida.http.post(
        "/api/v1/registry/imports/drones", content=text.encode(), headers={"content-type": "text/csv"}
    )
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert [(row["id"], row["exists"]) for row in found["rows"]] == [("OH-DRN-0417", True), ("NEW-1", False)]
    assert (found["error_count"], found["function"]) == (1, "RegisterUav")
    many = "uav_id,model,operator_id,registration\n" + "".join(
        f"NEW-{i},a longer model name,o,\n" for i in range(3_000)
    )
    wide = frida.http.post("/api/v1/registry/imports/drones", content=many.encode())
    assert (wide.status_code, len(wide.json()["rows"])) == (200, 3_000)
    large = frida.http.post("/api/v1/registry/imports/drones", content=b"x" * ((1 << 20) + 1))
    assert large.status_code == 413
    assert frida.http.post("/api/v1/registry/imports/people", content=b"").status_code == 422
    viewer = house.person("Vera", "viewer")
    assert viewer.http.post("/api/v1/registry/imports/drones", content=b"").status_code == 403
