"""Calibrations of ATI transducers, and gauge voltages that become forces by them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from written_logs import refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.force.calibration import AXES, read_calibration
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.record import ForceLogOptions, full_scale

MATRIX = np.random.default_rng(3).normal(size=(6, 6)).round(5)
RATINGS = [25.0, 25.0, 35.0, 250.0, 250.0, 250.0]
NEWTON = 'ForceUnits="N" TorqueUnits="N-mm"'
POUND = 0.45359237 * 9.80665


def rows(kind: str, matrix: np.ndarray, scale: np.ndarray | None = None) -> str:
    """The six elements of a matrix as calibrations write them."""
    scales = [""] * 6 if scale is None else [f' scale="{value!r}"' for value in scale.tolist()]
    held = zip(AXES, matrix.tolist(), RATINGS, scales, strict=True)
    return "\n".join(
        f'<{kind} Name="{axis}" values="{" ".join(map(repr, row))}" max="{rating}"{scaled}/>'
        for axis, row, rating, scaled in held
    )


def calibration(folder: Path, body: str = "", *, units: str = NEWTON) -> Path:
    head = '<?xml version="1.0" encoding="utf-8"?>\n<!-- made up -->\n<FTSensor Serial="FT1">\n'
    body = f"<Calibration {units}>\n{body or rows('UserAxis', MATRIX)}\n</Calibration>"
    (folder / "FT1.cal").write_text(f"{head}{body}</FTSensor>\n")
    return folder / "FT1.cal"


def about_gauges(offset: list[float]) -> np.ndarray:
    """Matrix about the gauges' origin, which lies ``offset`` from the transducer's: torque about
    a point d off is T − d × F.
    """
    matrix = MATRIX.copy()
    for gauge in range(6):
        matrix[3:, gauge] += np.cross(offset, MATRIX[:3, gauge])
    return matrix


def test_units_matrix_and_ratings_are_those_of_the_user_axes(tmp_path):
    others = rows("Axis", 7 * MATRIX, np.full(6, 2.0)) + '<BasicTransform Dx="0" Dy="0" Dz="9"/>'
    for body in (rows("UserAxis", MATRIX), others + rows("UserAxis", MATRIX)):
        result = read_calibration(calibration(tmp_path, body))
        assert (result.serial, result.force_unit, result.torque_unit) == ("FT1", "N", "N-mm")
        np.testing.assert_array_equal(result.matrix, MATRIX)
        np.testing.assert_allclose(full_scale(result), [25, 25, 35, 0.25, 0.25, 0.25])


def test_without_user_axes_the_scaled_matrix_about_the_gauges_origin_leads_to_the_same(tmp_path):
    scale = np.array([11.4, 11.4, 5.9, 1.8, 1.8, 1.6])
    axes = rows("Axis", about_gauges([0.4, -0.7, 6.1]) * scale[:, None], scale)
    transform = '<BasicTransform Dx="0.4" Dy="-0.7" Dz="6.1" Rx="0" Ry="0" Rz="{}"/>'
    result = read_calibration(calibration(tmp_path, axes + transform.format(0)))
    np.testing.assert_allclose(result.matrix, MATRIX, atol=1e-12)
    # the control: without the transform the torques are others
    assert np.abs(read_calibration(calibration(tmp_path, axes)).matrix - MATRIX).max() > 0.1
    turned = axes + transform.format(30)
    assert "turns the axes" in refusal(read_calibration, calibration(tmp_path, turned)).message


def test_an_offset_in_another_unit_than_the_torques_length_is_converted(tmp_path):
    axes = rows("Axis", about_gauges([0, 0, 6.1]), np.ones(6))
    for unit, offset in (("mm", 6.1), ("cm", 0.61), ("in", 6.1 / 25.4), ("cubit", 1.0)):
        body = axes + f'<BasicTransform Dx="0" Dy="0" Dz="{offset!r}"/>'
        file = calibration(tmp_path, body, units=f'{NEWTON} DistUnits="{unit}"')
        if unit == "cubit":
            assert "cubit" in refusal(read_calibration, file).message
        else:
            np.testing.assert_allclose(read_calibration(file).matrix, MATRIX, atol=1e-12)


GAUGES = ",".join(f"G{gauge}" for gauge in range(6))
SETTINGS = "Frequency = 1000,Averaging Level = 16,F/T Serial Number = FT1"


@pytest.mark.parametrize("thermistor", ["", ",Therm"])
def test_gauge_voltages_become_forces_by_the_matrix_of_their_transducer(tmp_path, thermistor):
    volts = np.random.default_rng(5).normal(size=(4, 6)).round(6)
    lines = [f"{GAUGES}{thermistor},{SETTINGS}"]
    lines += [",".join(map(repr, [*row, *([2.5] if thermistor else [])])) for row in volts.tolist()]
    file, options = (
        tmp_path / "log.csv",
        ForceLogOptions(calibration=read_calibration(calibration(tmp_path))),
    )
    file.write_text("\n".join(lines) + "\n")
    result = read_daqft(file, options)
    np.testing.assert_allclose(result.force, volts @ MATRIX[:3].T, rtol=1e-11)
    np.testing.assert_allclose(result.torque, volts @ MATRIX[3:].T * 1e-3, rtol=1e-11)
    with pytest.raises(RecordingError, match="calibration") as caught:
        read_daqft(file)
    assert caught.value.evidence["key"] == "dataset.force.log.calibration"
    file.write_text(file.read_text().replace("FT1", "FT2"))
    with pytest.raises(RecordingError, match=r"FT2.*FT1"):
        read_daqft(file, options)


def test_units_that_the_log_does_not_state_are_the_calibrations(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(f"Fx,Fy,Fz,Mx,My,Mz,{SETTINGS}\n1.5,2,3,4,5,6\n")
    with pytest.raises(RecordingError, match="no known unit") as caught:
        read_daqft(file)
    assert caught.value.evidence["key"] == "dataset.force.log.force_unit"
    pounds = read_calibration(calibration(tmp_path, units='ForceUnits="lb" TorqueUnits="in-lb"'))
    result = read_daqft(file, ForceLogOptions(calibration=pounds))
    np.testing.assert_allclose(result.force, [np.array([1.5, 2, 3]) * POUND], rtol=1e-12)
    np.testing.assert_allclose(result.torque, [np.array([4, 5, 6]) * POUND * 0.0254], rtol=1e-12)
    # the option comes before the calibration
    result = read_daqft(file, ForceLogOptions(calibration=pounds, force_unit="kN"))
    np.testing.assert_allclose(result.force, [[1500, 2000, 3000]])
