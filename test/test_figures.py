# Copyright 2026 the ppc_attitude authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the figures of a run show: lines, labels with units, limits, the record's own numbers."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from synthetic import (
    hit_run,
    normal_run,
    part_of,
    pulse_torque,
    times,
    with_columns,
    with_rows,
    without_columns,
)

from ppc_attitude.analysis.drawing import BLACK, save_all
from ppc_attitude.analysis.envelopes import ENVELOPES, Envelope
from ppc_attitude.analysis.figures import (
    angular_velocity_figure,
    applied_torque_figure,
    disturbance_figure,
    error_figure,
    figures_of,
    pointing_figure,
    transformed_errors_figure,
)
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.run_panels import zoom_window
from ppc_attitude.analysis.series import AnalysisError
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.attitude import product

NAMES = [
    "pointing_error",
    "attitude_error",
    "rate_error",
    "applied_torque",
    "angular_velocity",
    "disturbance",
    "transformed_errors",
    "auxiliary_state",
]
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def normal():
    return normal_run(70.0, rate=10.0)  # few enough samples to be drawn as they are


@pytest.fixture(scope="module")
def hit():
    return hit_run()


@pytest.fixture(scope="module")
def drawn(normal, hit):
    return [figures_of(Measured(run)) for run in (normal, hit)]


def labelled(axes):
    """Lines that the legend tells, by label."""
    return {
        line.get_label(): line
        for line in axes.get_lines()
        if not str(line.get_label()).startswith("_")
    }


def shows(line, t, values):
    assert np.array_equal(line.get_xdata(), t)
    assert np.array_equal(line.get_ydata(), values)


def test_the_attitude_error_in_its_envelope(normal):
    linear, logarithmic = error_figure(Measured(normal), ENVELOPES[0]).axes
    t, error = normal.stamps_ns / 1e9, normal["attitude_error"]
    for k, axis in enumerate("xyz"):
        shows(labelled(linear)[axis], t, error[:, k])
        shows(labelled(logarithmic)[axis], t, np.abs(error[:, k]))
    drawn = [line.get_ydata() for line in linear.get_lines()]
    for k in range(3):
        for sign in (1, -1):
            bound = sign * normal["attitude_envelope"][:, k]
            assert any(np.array_equal(bound, each) for each in drawn)
    assert linear.get_ylabel() == "attitude error $q_{e}$ [1]"
    assert logarithmic.get_ylabel() == "|attitude error $q_{e}$| [1]"
    assert logarithmic.get_yscale() == "log"
    assert linear.get_xlabel() == "time [s]"
    assert linear.get_xlim() == (0.0, 70.0)


def test_the_pointing_error_in_degrees(normal):
    (axes,) = pointing_figure(Measured(normal)).axes
    (line,) = [each for each in axes.get_lines() if len(each.get_xdata()) > 2]
    size = np.linalg.norm(normal["attitude_error"][:, :3], axis=1)
    assert np.allclose(line.get_ydata(), np.rad2deg(2.0 * np.arcsin(size)), rtol=1e-6, atol=1e-9)
    assert axes.get_ylabel() == "attitude error, angle [deg]"


def test_the_three_errors_are_drawn_where_they_differ(normal):
    told = with_columns(normal, truth_attitude=normal["reference_attitude"])
    (axes,) = pointing_figure(Measured(told)).axes
    assert list(labelled(axes)) == [
        "control: estimate against reference",
        "knowledge: truth against estimate",
        "pointing: truth against reference",
    ]


def test_limits_are_drawn_at_the_error_that_is_judged():
    """The law's own error met the limit in a figure of a run that missed it."""
    run = normal_run(120.0)
    off = np.array([1e-3, 0.0, 0.0, 1.0]) / np.sqrt(1.0 + 1e-6)
    truth = [product(tuple(each), tuple(off)) for each in run["attitude"]]
    drawn = figures_of(Measured(with_columns(run, truth_attitude=np.array(truth))))
    limit = "terminal < 0.0005"
    own, true = (
        labelled(drawn[name][1].axes[1]) for name in ("attitude_error", "true_attitude_error")
    )
    assert limit not in own
    t, level = true[limit].get_data()
    assert np.nanmin(np.abs(true["x"].get_ydata())[t >= 100.0]) > np.nanmax(level)


def test_limits_are_drawn_where_they_are_judged(hit):
    longer = normal_run(120.0)
    for run, label, judged in (
        (hit, "settled < 0.005", lambda t: (t >= 60.0) & ~((t >= 80.0) & (t <= 90.0))),
        (hit, "terminal < 0.0005", None),  # the hit at 80 s leaves too little time
        (longer, "terminal < 0.0005", lambda t: t >= 100.0),
    ):
        lines = labelled(error_figure(Measured(run), ENVELOPES[0]).axes[1])
        assert (label in lines) is (judged is not None)
        if judged is not None:
            t, level = lines[label].get_data()
            inside = judged(t)
            assert np.isfinite(level[inside]).mean() > 0.98
            assert np.isnan(level[~inside]).mean() > 0.98
    late = part_of(longer, slice(11_000, None))
    lines = labelled(error_figure(Measured(late), ENVELOPES[0]).axes[1])
    assert "terminal < 0.0005" not in lines  # of the last 20 s only ten are known
    bottom = angular_velocity_figure(Measured(hit)).axes[1]
    t, level = labelled(bottom)["limit 3 deg/s, judged to 20 s"].get_data()
    assert t[np.isfinite(level)].max() < 20.0


def test_the_rate_error_is_drawn_in_degrees(normal):
    linear, _ = error_figure(Measured(normal), ENVELOPES[1]).axes
    shows(labelled(linear)["y"], normal.t, np.rad2deg(normal["rate_error"])[:, 1])
    assert linear.get_ylabel() == "rate error z2 [deg/s]"  # as the angular velocity


def test_the_applied_torque_and_its_limits(normal):
    (axes,) = applied_torque_figure(Measured(normal)).axes
    t = normal.stamps_ns / 1e9
    shows(labelled(axes)["z"], t, normal["applied_torque"][:, 2])
    shows(labelled(axes)["limit ±0.05 N·m"], t, np.full(t.size, 0.05))
    assert axes.get_ylabel() == "applied torque [N·m]"
    weak = replace(normal, parameters={"spacecraft_plant": {"max_torque": 0.02}})
    (axes,) = applied_torque_figure(Measured(weak)).axes
    shows(labelled(axes)["limit ±0.02 N·m"], t, np.full(t.size, 0.02))
    assert axes.get_ylim()[1] > 0.05  # what broke the limit is in view


def test_a_torque_limit_that_changes_in_flight_is_drawn_as_it_changes(normal):
    changed = replace(normal, changes=(Change(30_000_000_000, PLANT, "max_torque", 0.02),))
    (axes,) = applied_torque_figure(Measured(changed)).axes
    t = normal.stamps_ns / 1e9
    shows(labelled(axes)["limit ±0.05, 0.02 N·m"], t, np.where(t < 30.0, 0.05, 0.02))


def test_the_angular_velocity_over_the_desired_one_in_body_axes(normal):
    t = normal.stamps_ns / 1e9
    # A craft turned by 90° about z: what the desired frame has on x, the body has on −y.
    half = np.sqrt(0.5)
    run = with_columns(
        normal,
        attitude=np.tile([0.0, 0.0, half, half], (t.size, 1)),
        reference_attitude=np.tile([0.0, 0.0, 0.0, 1.0], (t.size, 1)),
        reference_angular_velocity=np.tile([np.deg2rad(0.5), 0.0, 0.0], (t.size, 1)),
    )
    top, bottom = angular_velocity_figure(Measured(run)).axes
    rate = np.rad2deg(run["angular_velocity"])
    shows(labelled(top)["x"], t, rate[:, 0])
    desired = np.column_stack([labelled(top)[f"{axis} desired"].get_ydata() for axis in "xyz"])
    assert np.allclose(desired, [0.0, -0.5, 0.0], atol=1e-12)
    norm = labelled(bottom)["norm"]
    assert np.allclose(norm.get_ydata(), np.sqrt((rate**2).sum(axis=1)), rtol=1e-14)
    assert set(labelled(bottom)["limit 3 deg/s"].get_ydata()) == {3.0}
    assert "deg/s" in top.get_ylabel()
    assert "deg/s" in bottom.get_ylabel()


def test_a_run_without_reference_still_shows_its_rate(normal):
    run = Measured(without_columns(normal, "reference_angular_velocity"))
    assert list(labelled(angular_velocity_figure(run).axes[0])) == ["x", "y", "z"]


def test_the_disturbance(normal, hit):
    (axes,) = disturbance_figure(Measured(normal)).axes
    shows(labelled(axes)["x"], normal.stamps_ns / 1e9, normal["disturbance_torque"][:, 0])
    whole, enlarged = disturbance_figure(Measured(hit)).axes
    assert whole.get_ylim()[1] > 0.8
    assert 3e-3 < enlarged.get_ylim()[1] < 5e-3
    assert "N·m" in whole.get_ylabel()


def test_where_there_is_no_environment_none_is_enlarged(hit):
    t = hit.stamps_ns / 1e9
    torque = pulse_torque(t, [(20.0, 0.1, (0.8, 0.8, 0.8))])
    run = Measured(with_columns(hit, disturbance_torque=torque))
    assert len(run.hits) == 1
    assert len(disturbance_figure(run).axes) == 1


def test_the_transformed_errors(normal, hit):
    attitude, rate = transformed_errors_figure(Measured(normal)).axes
    epsilon = normal["attitude_error"][:, :3] / normal["attitude_envelope"]
    shows(labelled(attitude)["x"], normal.stamps_ns / 1e9, epsilon[:, 0])
    epsilon = normal["rate_error"] / normal["rate_envelope"]
    shows(labelled(rate)["z"], normal.stamps_ns / 1e9, epsilon[:, 2])
    for axes in (attitude, rate):
        assert [line.get_ydata() for line in axes.get_lines()[3:]] == [[1.0, 1.0], [-1.0, -1.0]]
    far = with_columns(hit, rate_error=1e3 * hit["rate_envelope"])
    attitude, rate = transformed_errors_figure(Measured(far)).axes
    assert (attitude.get_yscale(), rate.get_yscale()) == ("linear", "symlog")
    assert "logarithmic beyond ±1" in rate.get_ylabel()
    assert "logarithmic" not in attitude.get_ylabel()


def test_what_a_law_has_besides_is_drawn_as_it_is_declared(normal, drawn):
    caption, figure = drawn[0]["auxiliary_state"]
    (axes,) = figure.axes
    assert caption == "Anti-saturation state θ"
    assert axes.get_ylabel() == "auxiliary state [1]"
    shows(labelled(axes)["y"], normal.stamps_ns / 1e9, normal["auxiliary_state"][:, 1])


def test_a_hit_is_marked_and_shown_closely(hit):
    run = Measured(hit)
    *whole, close = error_figure(run, ENVELOPES[0]).axes
    for axes in whole:
        marks = [line.get_xdata()[0] for line in axes.get_lines() if line.get_marker() == "v"]
        assert marks == [20.0, 80.0]
    assert [line.get_xdata()[0] for line in close.get_lines() if line.get_marker() == "v"] == [80.0]
    assert close.get_xlim() == (78.0, 92.0)
    bound = hit["attitude_envelope"][7800:9201].max()
    assert close.get_ylim()[1] == pytest.approx(1.1 * bound, rel=1e-12)
    assert error_figure(run, ENVELOPES[1]).axes[2].get_yscale() == "log"
    assert applied_torque_figure(run).axes[1].get_xlim() == (78.0, 92.0)


def test_every_line_is_in_a_legend(drawn):
    """By its colour and dashes, or, for an envelope, by the black dashes that stand for all."""
    for figures in drawn:
        for name, (_, figure) in figures.items():
            told = {
                (line.get_color(), line.get_linestyle() == "-", line.get_marker())
                for axes in figure.axes
                if axes.get_legend() is not None
                for line in axes.get_legend().get_lines()
            }
            for line in (line for axes in figure.axes for line in axes.get_lines()):
                if len(line.get_xdata()) == 0 or line.get_zorder() == 0.5:  # or under a hit's mark
                    continue
                colour, plain = line.get_color(), line.get_linestyle() == "-"
                known = {(colour, plain, line.get_marker()), (BLACK, plain, "None")}
                assert known & told, (name, line)


@pytest.mark.parametrize(
    ("hits", "window"),
    [
        ([], None),
        ([20.0], None),
        ([20.0, 80.0], (78.0, 92.0)),
        ([61.0, 80.0], (59.0, 73.0)),
        ([115.0], (113.0, 120.0)),
    ],
)
def test_what_is_shown_closely(hits, window):
    assert zoom_window(times(120.0)[1], hits, 60.0) == window


def test_every_panel_tells_its_time_and_unit(drawn):
    for figures in drawn:
        for name, (_, figure) in figures.items():
            assert figure.axes[-1].get_xlabel() == "time [s]", name
            assert all(axes.get_ylabel().endswith("]") for axes in figure.axes), name
            assert figure.get_size_inches()[0] == 3.5


def test_figures_are_saved_and_nothing_collides(tmp_path, drawn, recwarn):
    """A layout that does not fit is told by a warning."""
    figures, folder = drawn[1], tmp_path / "new" / "folder"
    assert list(figures) == NAMES
    paths = save_all({name: figures[name] for name in NAMES[:2]}, folder)
    assert [path.stem for path in paths] == NAMES[:2]
    assert all(path.parent == folder and path.read_bytes().startswith(PNG) for path in paths)
    for name in NAMES[2:]:  # where all is placed shows without painting it
        figures[name][1].draw_without_rendering()
    assert [str(each.message) for each in recwarn if each.category is UserWarning] == []


def test_figures_are_saved_as_drawings_too(tmp_path, drawn):
    paths = save_all({"torque": drawn[0]["applied_torque"]}, tmp_path, ["svg", "pdf", "svg"])
    assert [path.name for path in paths] == ["torque.svg", "torque.pdf"]
    assert [path.read_bytes()[:4] for path in paths] == [b"<?xm", b"%PDF"]


def test_only_what_the_controller_has(normal):
    plain = without_columns(
        normal, "attitude_envelope", "rate_error", "rate_envelope", "auxiliary_state"
    )
    assert list(figures_of(Measured(plain))) == [
        "pointing_error",
        "attitude_error",
        "applied_torque",
        "angular_velocity",
        "disturbance",
    ]


def test_an_envelope_that_is_zero_before_the_first_fix_takes_no_decades(normal):
    """The panel of a run with `initial_fix: false` reached down to 1e-16."""
    late = with_rows(normal, "attitude_envelope", slice(3), 0.0)
    figures = (error_figure(Measured(run), ENVELOPES[0]) for run in (normal, late))
    usual, found = (figure.axes[1].get_ylim()[0] for figure in figures)
    assert usual == found


def test_nothing_to_draw(normal):
    with pytest.raises(AnalysisError, match="no sample at all"):
        figures_of(Measured(part_of(normal, slice(0))))
    with pytest.raises(AnalysisError, match="nothing to draw"):
        figures_of(Measured(replace(normal, columns={})))


def test_a_single_instant():
    for _, figure in figures_of(Measured(normal_run(0.0))).values():
        figure.draw_without_rendering()


def test_global_state_is_left_alone(normal):
    before = dict(mpl.rcParams)
    figures_of(Measured(normal))
    assert dict(mpl.rcParams) == before


def test_where_no_applied_torque_is_on_record_the_commanded_one_is_drawn(normal, drawn):
    assert "torque_command" not in drawn[0]
    assert "torque_command" in figures_of(Measured(without_columns(normal, "applied_torque")))


def test_each_part_with_a_bound_is_drawn_by_its_name(normal):
    """Only the first three were, as x, y and z."""
    row = np.ones((normal.t.size, 8))
    run = Measured(with_columns(normal, wheel_speed=row, wheel_torque=2.0 * row))
    figure = error_figure(run, Envelope("wheel_speed", "wheel_torque"))
    told = {text.get_text() for text in figure.axes[0].get_legend().get_texts()}
    assert told == {*(f"wheel {k}" for k in range(8)), "envelope"}
    assert not any("settled" in name for axes in figure.axes for name in labelled(axes))
