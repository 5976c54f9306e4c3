"""The track as maps read it: places by an independent geodesy, well-formed files whatever the names hold."""

import dataclasses
import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from core.findings import Severity
from pipeline.results.failure import Failure
from reports.files.tracks import FILES, write_track
from tests.reports.accounts import account, happening

KML, GPX = "{http://www.opengis.net/kml/2.2}", "{http://www.topografix.com/GPX/1/1}"


@pytest.fixture
def eventful(flight):
    lost = happening("gps-lost", flight.flight.start + 10.0, Severity.WARNING, 2.0, reason='GPS <lost> & "found"\x07.')
    return dataclasses.replace(flight, account=account(lost))


def test_three_files_hold_the_same_track(eventful, tmp_path):
    files = write_track(eventful, tmp_path)
    assert [file.name for file in files] == list(FILES)
    features = json.loads(files[0].read_text("utf-8"))["features"]
    line = np.array(features[0]["geometry"]["coordinates"])
    kml = ElementTree.parse(files[1]).getroot()
    drawn = kml.find(f".//{KML}LineString/{KML}coordinates").text.split()
    gpx = ElementTree.parse(files[2]).getroot()
    places = [(float(p.get("lon")), float(p.get("lat"))) for p in gpx.iter(f"{GPX}trkpt")]
    assert len(line) == len(drawn) == len(places)
    np.testing.assert_allclose(line[:, :2], places, atol=1e-8)
    # Against a sphere of the ellipsoid's local radii: metres per degree at the origin.
    origin = eventful.trajectory.origin
    a, e2 = 6378137.0, 6.69437999014e-3
    meridian = a * (1.0 - e2) / (1.0 - e2 * np.sin(origin.lat) ** 2) ** 1.5
    parallel = a / np.sqrt(1.0 - e2 * np.sin(origin.lat) ** 2) * np.cos(origin.lat)
    states = eventful.trajectory.states
    north = np.interp(features[0]["properties"]["t_s"], states.index, states["p_n"])
    east = np.interp(features[0]["properties"]["t_s"], states.index, states["p_e"])
    np.testing.assert_allclose((np.radians(line[:, 1]) - origin.lat) * meridian, north, atol=0.05)
    np.testing.assert_allclose((np.radians(line[:, 0]) - origin.lon) * parallel, east, atol=0.05)


def test_events_are_points_and_their_text_is_escaped(eventful, tmp_path):
    geojson, kml, gpx = write_track(eventful, tmp_path)
    mark = json.loads(geojson.read_text("utf-8"))["features"][1]
    assert mark["geometry"]["type"] == "Point"
    assert mark["properties"]["name"] == "gps lost"
    assert "<lost>" in ElementTree.parse(kml).getroot().find(f".//{KML}description").text
    assert ElementTree.parse(gpx).getroot().find(f"{GPX}wpt/{GPX}name").text == "gps lost"


def test_without_a_position_there_is_no_track_and_an_old_one_goes(eventful, tmp_path):
    write_track(eventful, tmp_path)
    assert write_track(dataclasses.replace(eventful, trajectory=Failure("trajectory", "no IMU")), tmp_path) == ()
    assert list(tmp_path.iterdir()) == []
