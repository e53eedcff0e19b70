"""When zones hold: schedules, offsets, midnight, daylight, and the sun that does not set."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from math import acos, cos, degrees, radians, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_backend.zones.applicability import DAY_MS, merged, spans
from wonderland_backend.zones.zone import zone_of

TURKU, UTSJOKI, LONGYEARBYEN = (22.27, 60.45), (27.03, 69.91), (15.6, 78.2)
HOUR = 3_600_000


def ms(text):
    return round(datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp() * 1000)


def zone(*periods, at=TURKU):
    point = {"type": "Point", "coordinates": list(at), "extent": {"subType": "Circle", "radius": 10}}
    its = {"identifier": "T", "country": "FIN", "type": "PROHIBITED", "limitedApplicability": list(periods)}
    return zone_of(json.dumps({"geometry": point, "properties": its}))


def scheduled(*daily, at=TURKU, **more):
    return zone({"schedule": list(daily), **more}, at=at)


def shown(found):
    return [tuple(datetime.fromtimestamp(each / 1000, UTC).strftime("%a %d %H:%M") for each in span) for span in found]


WEEK = ms("2026-06-01"), ms("2026-06-08")  # from a Monday


def test_a_zone_without_periods_always_holds_within_its_data_set():
    assert spans(zone(), *WEEK) == [WEEK]
    assert spans(zone(), *WEEK, (ms("2026-06-03"), ms("2026-06-04"))) == [(ms("2026-06-03"), ms("2026-06-04"))]
    assert spans(zone(), *WEEK, (ms("2026-07-01"), None)) == []


def test_a_period_between_two_times():
    its = zone({"startDateTime": "2026-06-02T10:00:00+02:00", "endDateTime": "2026-06-03T00:00:00.500Z"})
    assert shown(spans(its, *WEEK)) == [("Tue 02 08:00", "Wed 03 00:00")]


def test_a_weekly_schedule_and_one_over_midnight():
    its = scheduled(
        {"day": ["MON"], "startTime": "08:00:00Z", "endTime": "16:00:00Z"},
        {"day": ["FRI", "SUN"], "startTime": "22:00:00Z", "endTime": "04:00:00Z"},
    )
    assert shown(spans(its, *WEEK)) == [
        ("Mon 01 00:00", "Mon 01 04:00"),  # of the Sunday before
        ("Mon 01 08:00", "Mon 01 16:00"),
        ("Fri 05 22:00", "Sat 06 04:00"),
        ("Sun 07 22:00", "Mon 08 00:00"),
    ]


def test_the_day_of_the_week_is_that_of_the_times_offset():
    its = scheduled({"day": ["TUE"], "startTime": "01:00:00+03:00", "endTime": "02:00:00+03:00"})
    assert shown(spans(its, *WEEK)) == [("Mon 01 22:00", "Mon 01 23:00")]
    its = scheduled({"day": ["TUE"], "startTime": "20:00:00-08:00", "endTime": "24:00:00-08:00"})
    assert shown(spans(its, *WEEK)) == [("Wed 03 04:00", "Wed 03 08:00")]


@pytest.mark.parametrize(
    ("daily", "expected"),
    [
        ({"day": ["WED"]}, ("Wed 03 00:00", "Thu 04 00:00")),
        ({"day": ["WED"], "startTime": "12:00:00Z"}, ("Wed 03 12:00", "Thu 04 00:00")),
        ({"day": ["WED"], "endTime": "06:00:00Z"}, ("Wed 03 00:00", "Wed 03 06:00")),
        ({"day": ["WED"], "startTime": "00:00:00Z", "endTime": "00:00:00Z"}, ("Wed 03 00:00", "Thu 04 00:00")),
        ({"day": ["WED"], "startTime": "00:00:00+02:00", "endTime": "24:00:00+02:00"}, ("Tue 02 22:00", "Wed 03 22:00")),
    ],
)  # fmt: skip
def test_what_is_not_said_is_the_whole_day(daily, expected):
    assert shown(spans(scheduled(daily), *WEEK)) == [expected]


def half_day_ms(lat_deg, declination_deg, below_deg):
    """Half of the time for which the sun's centre is higher than so far below the horizon."""
    lat, declination, height = map(radians, (lat_deg, declination_deg, -below_deg))
    cosine = (sin(height) - sin(lat) * sin(declination)) / (cos(lat) * cos(declination))
    return degrees(acos(cosine)) / 15 * HOUR


@pytest.mark.parametrize(
    ("day", "declination_deg", "equation_min"), [("2026-12-21", -23.44, 1.8), ("2026-03-20", -0.1, -7.5)]
)
@pytest.mark.parametrize(("events", "below_deg"), [(("SR", "SS"), 0.833), (("BMCT", "EECT"), 6.0)])
def test_daylight_at_turku(day, declination_deg, equation_min, events, below_deg):
    """Against the hour angle by the sun's declination and the equation of time of those days."""
    its = scheduled({"day": ["ANY"], "startEvent": events[0], "endEvent": events[1]})
    noon = ms(day) + 12 * HOUR - (TURKU[0] * 4 + equation_min) * 60_000
    half = half_day_ms(TURKU[1], declination_deg, below_deg)
    ((start, end),) = spans(its, ms(day), ms(day) + DAY_MS)
    assert start == pytest.approx(noon - half, abs=3 * 60_000)
    assert end == pytest.approx(noon + half, abs=3 * 60_000)


def test_a_night_goes_into_the_next_day():
    its = scheduled({"day": ["MON"], "startEvent": "SS", "endEvent": "SR"})
    ((start, end),) = spans(its, ms("2026-12-21"), ms("2026-12-28"))
    assert ms("2026-12-21T13:00") < start < ms("2026-12-21T14:00")
    assert ms("2026-12-22T07:00") < end < ms("2026-12-22T08:00")


def test_where_the_sun_does_not_set_daylight_has_no_end_and_night_does_not_come():
    summer = ms("2026-06-10"), ms("2026-06-13")
    assert spans(scheduled({"day": ["ANY"], "startEvent": "SR", "endEvent": "SS"}, at=UTSJOKI), *summer) == [summer]
    assert spans(scheduled({"day": ["ANY"], "startEvent": "SS", "endEvent": "SR"}, at=UTSJOKI), *summer) == []


def test_where_the_sun_does_not_rise_it_is_night():
    winter = ms("2026-12-10"), ms("2026-12-13")
    assert spans(scheduled({"day": ["ANY"], "startEvent": "SR", "endEvent": "SS"}, at=UTSJOKI), *winter) == []
    assert spans(scheduled({"day": ["ANY"], "startEvent": "SS", "endEvent": "SR"}, at=UTSJOKI), *winter) == [winter]
    # There is some twilight at noon in Utsjoki, and none on Svalbard.
    twilight = {"day": ["ANY"], "startEvent": "BMCT", "endEvent": "EECT"}
    assert len(spans(scheduled(twilight, at=UTSJOKI), *winter)) == 3
    assert spans(scheduled(twilight, at=LONGYEARBYEN), *winter) == []


def test_a_time_and_an_event():
    its = scheduled({"day": ["MON"], "startTime": "12:00:00Z", "endEvent": "SS"})
    ((start, end),) = spans(its, ms("2026-12-21"), ms("2026-12-28"))
    assert start == ms("2026-12-21T12:00")
    assert ms("2026-12-21T13:00") < end < ms("2026-12-21T14:00")


times = st.builds(
    lambda minute, offset: (minute, offset, f"{minute // 60:02}:{minute % 60:02}:00"
                            + ("Z" if offset == 0 else f"{'+' if offset > 0 else '-'}{abs(offset):02}:00")),
    st.integers(0, 1439), st.integers(-12, 14),
)  # fmt: skip
DAYS = ("MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN")


@settings(max_examples=200, deadline=None)
@given(start=times, end=times, days=st.sets(st.sampled_from(DAYS), min_size=1), at=st.integers(0, 13 * 24 * 60 - 1))
def test_a_schedule_holds_exactly_when_a_slow_look_at_the_calendar_says_so(start, end, days, at):
    """Against the definition, minute by minute: on a named day at its own offset, from start to end or past midnight."""
    its = scheduled({"day": sorted(days), "startTime": start[2], "endTime": end[2]})
    first = ms("2026-03-23")
    moment = first + at * 60_000
    expected = False
    for back in range(-3, 4):
        day = datetime.fromtimestamp(moment / 1000, UTC).date() + timedelta(days=back)
        if DAYS[day.weekday()] in days:
            midnight = ms(day.isoformat())
            begin = midnight + start[0] * 60_000 - start[1] * HOUR
            stop = midnight + end[0] * 60_000 - end[1] * HOUR
            stop += 0 if stop > begin else DAY_MS
            expected = expected or begin <= moment < stop
    found = spans(its, first, first + 13 * DAY_MS)
    assert any(begin <= moment < stop for begin, stop in found) == expected
    assert found == merged(found)


@settings(max_examples=60, deadline=None)
@given(
    events=st.tuples(st.sampled_from(["BMCT", "SR", "SS", "EECT"]), st.sampled_from(["BMCT", "SR", "SS", "EECT"])),
    lat=st.floats(-89, 89),
    lon=st.floats(-180, 180),
    day=st.integers(0, 364),
)
def test_daylight_gives_ordered_spans_anywhere_on_any_day_and_parts_agree_with_the_whole(events, lat, lon, day):
    its = scheduled({"day": ["ANY"], "startEvent": events[0], "endEvent": events[1]}, at=(round(lon, 3), round(lat, 3)))
    start = ms("2026-01-01") + day * DAY_MS
    whole = spans(its, start, start + 4 * DAY_MS)
    assert all(begin < end for begin, end in whole)
    assert whole == merged(whole)
    parts = [span for hour in range(0, 96, 8) for span in spans(its, start + hour * HOUR, start + (hour + 8) * HOUR)]
    assert merged(parts) == whole
