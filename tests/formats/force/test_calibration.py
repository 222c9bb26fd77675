from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.errors import RecordingError
from pipeline.formats.force.calibration import AXES, read_calibration
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.record import ForceLogOptions, full_scale

MATRIX = np.random.default_rng(3).normal(size=(6, 6)).round(5)
RATINGS = [25.0, 25.0, 35.0, 250.0, 250.0, 250.0]


def rows(kind: str, matrix: np.ndarray, scale: np.ndarray | None = None) -> str:
    """The six elements of a matrix as calibrations write them."""
    scales = [""] * 6 if scale is None else [f' scale="{value!r}"' for value in scale.tolist()]
    lines = [
        f'<{kind} Name="{axis}" values="{" ".join(map(repr, row))}" max="{rating}"{scaled}/>'
        for axis, row, rating, scaled in zip(AXES, matrix.tolist(), RATINGS, scales, strict=True)
    ]
    return "\n".join(lines)


def calibration(
    folder,
    body: str = "",
    *,
    head: str = '<?xml version="1.0" encoding="utf-8"?>',
    units: str = 'ForceUnits="N" TorqueUnits="N-mm"',
):
    body = body or rows("UserAxis", MATRIX)
    file = folder / "FT1.cal"
    file.write_text(
        f'{head}\n<!-- made up -->\n<FTSensor Serial="FT1" NumGages="6">\n<Calibration '
        f"{units}>\n{body}\n</Calibration></FTSensor>\n"
    )
    return file


def refusal(file) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_calibration(file)
    assert caught.value.evidence["file"] == file
    return caught.value


def test_units_matrix_and_ratings_are_those_of_the_user_axes(tmp_path):
    others = rows("Axis", 7 * MATRIX, np.full(6, 2.0)) + '<BasicTransform Dx="0" Dy="0" Dz="9"/>'
    for body in (rows("UserAxis", MATRIX), others + rows("UserAxis", MATRIX)):
        result = read_calibration(calibration(tmp_path, body))
        assert (result.serial, result.force_unit, result.torque_unit) == ("FT1", "N", "N-mm")
        np.testing.assert_array_equal(result.matrix, MATRIX)
        np.testing.assert_allclose(full_scale(result), [25, 25, 35, 0.25, 0.25, 0.25])


def test_without_user_axes_the_scaled_matrix_about_the_gauges_origin_leads_to_the_same(tmp_path):
    """Torque about a point d off is T − d × F: the wrench of a force at a known place, seen from
    both origins.
    """
    offset, scale = np.array([0.4, -0.7, 6.1]), np.array([11.4, 11.4, 5.9, 1.8, 1.8, 1.6])
    about_gauges = MATRIX.copy()
    for gauge in range(6):
        about_gauges[3:, gauge] += np.cross(offset, MATRIX[:3, gauge])
    transform = (
        f'<BasicTransform Dx="{offset[0]}" Dy="{offset[1]}" Dz="{offset[2]}" Rx="0" Ry="0" Rz="0"/>'
    )
    result = read_calibration(
        calibration(tmp_path, rows("Axis", about_gauges * scale[:, None], scale) + transform)
    )
    np.testing.assert_allclose(result.matrix, MATRIX, atol=1e-12)
    # the control: without the transform the torques are others
    other = read_calibration(
        calibration(tmp_path, rows("Axis", about_gauges * scale[:, None], scale))
    )
    assert np.abs(other.matrix - MATRIX).max() > 0.1


def test_an_offset_in_another_unit_than_the_torques_length_is_converted(tmp_path):
    about_gauges = MATRIX.copy()
    for gauge in range(6):
        about_gauges[3:, gauge] += np.cross([0, 0, 6.1], MATRIX[:3, gauge])
    for unit, offset in (("mm", 6.1), ("cm", 0.61), ("in", 6.1 / 25.4)):
        body = (
            rows("Axis", about_gauges, np.ones(6))
            + f'<BasicTransform Dx="0" Dy="0" Dz="{offset!r}"/>'
        )
        file = calibration(
            tmp_path, body, units=f'ForceUnits="N" TorqueUnits="N-mm" DistUnits="{unit}"'
        )
        np.testing.assert_allclose(read_calibration(file).matrix, MATRIX, atol=1e-12)
    file = calibration(tmp_path, body, units='ForceUnits="N" TorqueUnits="N-mm" DistUnits="cubit"')
    assert "cubit" in refusal(file).message


@pytest.mark.parametrize("encoding", ["klingon", "big5", "utf-7"])
def test_an_encoding_that_cannot_be_read_is_refused(tmp_path, encoding):
    error = refusal(calibration(tmp_path, head=f'<?xml version="1.0" encoding="{encoding}"?>'))
    assert "save it as UTF-8" in error.message or "no XML" in error.message


ENTITIES = "".join(
    f"<!ENTITY {b} '{f'&{a};' * 10}'>" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
BOMB = f"<!DOCTYPE bomb [<!ENTITY a 'ha'>{ENTITIES}]>"


@pytest.mark.parametrize(
    "head",
    [
        BOMB,
        '<!DOCTYPE x [<!ENTITY outside SYSTEM "file:///etc/hostname">]>',
        '<!DOCTYPE x SYSTEM "http://example.org/x.dtd">',
    ],
)
def test_entities_and_document_types_are_refused_before_they_expand(tmp_path, head):
    for body in (rows("UserAxis", MATRIX), "&i;&outside;"):
        assert "document type" in refusal(calibration(tmp_path, body, head=head)).message


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('Name="Tz"', 'Name="Mz"', "no UserAxis Tz"),
        (" TorqueUnits", " Units", "0 elements state"),
        ('max="35.0"', 'max="-35"', "not positive"),
        ('max="35.0"', 'max="nan"', "finite"),
        ('max="35.0"', "", "max of Fz"),
        (repr(MATRIX[0, 0].item()), "", "values of Fx must be 6"),
        (repr(MATRIX[0, 0].item()), "1e999", "values of Fx must be 6"),
        ("</FTSensor>", "", "no XML"),
        ("<FTSensor", "<Calibration ForceUnits='lbf' TorqueUnits='lbf-in'/><FTSensor", "no XML"),
    ],
)
def test_a_calibration_that_leaves_something_open_is_refused(tmp_path, old, new, words):
    file = calibration(tmp_path)
    file.write_text(file.read_text().replace(old, new, 1))
    assert words in refusal(file).message


def test_a_transform_that_turns_the_axes_is_refused(tmp_path):
    body = (
        rows("Axis", MATRIX, np.ones(6))
        + '<BasicTransform Dx="0" Dy="0" Dz="0" Rx="0" Ry="0" Rz="30"/>'
    )
    assert "turns the axes" in refusal(calibration(tmp_path, body)).message


@settings(derandomize=True, max_examples=60, deadline=None)
@given(data=st.data())
def test_a_calibration_cut_or_damaged_at_any_byte_is_whole_or_refused(tmp_path_factory, data):
    file = calibration(tmp_path_factory.mktemp("cal"))
    content = file.read_bytes()
    at = data.draw(st.integers(0, len(content) - 1))
    file.write_bytes(
        data.draw(
            st.sampled_from(
                [
                    content[:at],
                    content[:at] + b"<" + content[at:],
                    content[:at] + b"\0" + content[at:],
                ]
            )
        )
    )
    try:
        result = read_calibration(file)
    except RecordingError:
        return
    np.testing.assert_array_equal(result.matrix, MATRIX)


GAUGES = ",".join(f"G{gauge}" for gauge in range(6))
SETTINGS = (
    "Frequency = 1000,Averaging Level = 16,F/T Serial Number = FT1,Time Started = "
    "1/2/2024 3:04:05 PM"
)


@pytest.mark.parametrize("thermistor", ["", ",Therm"])
def test_gauge_voltages_become_forces_by_the_matrix(tmp_path, thermistor):
    volts = np.random.default_rng(5).normal(size=(4, 6)).round(6)
    lines = [f"{GAUGES}{thermistor},{SETTINGS}"]
    lines += [",".join(map(repr, [*row, *([2.5] if thermistor else [])])) for row in volts.tolist()]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    result = read_daqft(
        tmp_path / "log.csv", ForceLogOptions(calibration=read_calibration(calibration(tmp_path)))
    )
    np.testing.assert_allclose(result.force, [MATRIX[:3] @ row for row in volts], rtol=1e-12)
    np.testing.assert_allclose(
        result.torque, [MATRIX[3:] @ row * 1e-3 for row in volts], rtol=1e-12
    )
    with pytest.raises(RecordingError, match="calibration") as caught:
        read_daqft(tmp_path / "log.csv")
    assert caught.value.evidence["key"] == "dataset.force.log.calibration"


def test_the_calibration_of_another_transducer_is_refused(tmp_path):
    (tmp_path / "log.csv").write_text(f"{GAUGES},{SETTINGS.replace('FT1', 'FT2')}\n0,0,0,0,0,0\n")
    with pytest.raises(RecordingError, match=r"FT2.*FT1"):
        read_daqft(
            tmp_path / "log.csv",
            ForceLogOptions(calibration=read_calibration(calibration(tmp_path))),
        )


def test_units_that_the_log_does_not_state_are_the_calibrations(tmp_path):
    (tmp_path / "log.csv").write_text(f"Fx,Fy,Fz,Mx,My,Mz,{SETTINGS}\n1.5,2,3,4,5,6\n")
    with pytest.raises(RecordingError, match="no known unit") as caught:
        read_daqft(tmp_path / "log.csv")
    assert caught.value.evidence["key"] == "dataset.force.log.force_unit"
    cal = read_calibration(calibration(tmp_path, units='ForceUnits="lb" TorqueUnits="in-lb"'))
    result = read_daqft(tmp_path / "log.csv", ForceLogOptions(calibration=cal))
    np.testing.assert_allclose(
        result.force, [np.array([1.5, 2, 3]) * 0.45359237 * 9.80665], rtol=1e-12
    )
    np.testing.assert_allclose(
        result.torque, [np.array([4, 5, 6]) * 0.45359237 * 9.80665 * 0.0254], rtol=1e-12
    )
    # the option comes before the calibration
    result = read_daqft(tmp_path / "log.csv", ForceLogOptions(calibration=cal, force_unit="kN"))
    np.testing.assert_allclose(result.force, [[1500, 2000, 3000]])
