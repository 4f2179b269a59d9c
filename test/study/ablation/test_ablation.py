"""Changes are those of hand-computed pairs, mechanisms act where they must, recordings count as well."""

import json
import math

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.params import diff
from panoptic_ros.study.ablation.ablation import measure_case
from panoptic_ros.study.ablation.differences import (
    DEFAULT,
    EVERYTHING,
    Difference,
    over_scenes,
    paired,
    summary,
)
from panoptic_ros.study.ablation.figures import FIGURES, figures_of, solve
from panoptic_ros.study.ablation.mechanisms import MECHANISMS, chosen
from panoptic_ros.study.cropping import HALF
from panoptic_ros.study.names import parsed
from panoptic_ros.study.world import recorded_world, simulated_world

TINY = {"scene": "three-views-2p", "seed": 3, "frames": 12, "model": ""}


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda mechanism: mechanism.name)
def test_what_switches_a_mechanism_off_is_not_the_default(mechanism):
    configs = configure(mechanism.off)
    assert {stage: diff(configs[stage]) for stage in mechanism.off} == mechanism.off


def test_mechanisms_are_chosen_by_name_or_part_in_the_order_of_the_table():
    assert chosen([]) == MECHANISMS
    words = [m.name for m in MECHANISMS] + list({m.part for m in MECHANISMS})
    assert len(set(words)) == len(words)
    tracking = [m for m in MECHANISMS if m.part == "tracking"]
    assert list(chosen(["lag", "tracking"])) == [*tracking, *chosen(["lag"])]
    with pytest.raises(UsageError, match="luck"):
        chosen(["lag", "luck"])


def test_a_paired_change_is_the_mean_of_the_pairs_with_its_standard_error():
    found = paired([3.0, 5.0, 10.0, math.nan], [1.0, 2.0, 6.0, 9.0])  # changes 2, 3, 4
    assert found.mean == pytest.approx(3.0) and found.freedom == 2.0
    assert found.error == pytest.approx(1.0 / math.sqrt(3.0))
    assert found.clear  # 5.2 standard errors; Student's t at 2 degrees of freedom is 4.3
    assert not paired([2.0, 3.0], [1.0, 1.0]).clear  # 3 standard errors, 12.7 at 1
    alone = paired([2.0], [1.5])
    assert alone.mean == 0.5 and math.isnan(alone.error) and not alone.clear
    assert math.isnan(paired([math.nan], [1.0]).mean)
    assert paired([2.0, 3.0], [1.0, 2.0]).clear and not paired([1.0, 2.0], [1.0, 2.0]).clear


def test_scenes_count_the_same_and_errors_add_up():
    unknown = Difference(math.nan, 0.1, 1.0)
    found = over_scenes([Difference(1.0, 0.3, 2.0), Difference(3.0, 0.4, 4.0), unknown])
    assert found.mean == pytest.approx(2.0) and found.error == pytest.approx(0.25)
    assert found.freedom == pytest.approx(0.25**2 / (0.09**2 / 2.0 + 0.16**2 / 4.0))
    assert math.isnan(over_scenes([Difference(1.0, math.nan, 0.0), Difference(1.0, 0.1, 2.0)]).error)


def sample(**given):
    return {figure.key: given.get(figure.key, 0.0) for figure in FIGURES}


def test_the_table_holds_hand_computed_changes_and_names_what_earns_nothing():
    samples = {
        "one": {
            DEFAULT: [sample(mpjpe_mm=10.0), sample(mpjpe_mm=12.0)],
            "lag": [sample(mpjpe_mm=13.0), sample(mpjpe_mm=15.2)],
            "bone-lengths": [sample(mpjpe_mm=9.0), sample(mpjpe_mm=11.0)],
        },
        "two": {DEFAULT: [sample(mpjpe_mm=20.0)], "lag": [sample(mpjpe_mm=21.0)]},
    }
    rows = [
        {"scene": scene, "off": off} | row
        for scene, runs in samples.items()
        for off, found in runs.items()
        for row in found
    ]
    blocks = summary(rows, ["lag", "bone-lengths"])
    assert [block["scene"] for block in blocks] == [EVERYTHING, "one", "two"]
    both, one, two = blocks
    assert both["default"]["mpjpe_mm"] == pytest.approx((11.0 + 20.0) / 2.0)
    assert one["off"]["lag"]["mpjpe_mm"] == {
        "mean": pytest.approx(3.1),
        "error": pytest.approx(0.1),
        "clear": True,
    }
    assert one["off"]["bone-lengths"]["mpjpe_mm"]["mean"] == pytest.approx(-1.0)
    assert two["off"]["lag"]["mpjpe_mm"] == {"mean": 1.0, "error": None, "clear": False}
    assert both["off"]["lag"]["mpjpe_mm"]["mean"] == pytest.approx((3.1 + 1.0) / 2.0)
    mechanisms = [{"part": m.part, "name": m.name, "about": m.about} for m in chosen(["lag", "bone-lengths"])]
    result = {"seeds": [4, 5], "mechanisms": mechanisms, "scenes": blocks}
    text = "\n".join(parsed("ablation", []).lines(json.loads(json.dumps(result))))
    assert "+3.10 ±0.10*" in text and "one (2)" in text and "Seeds 4 to 5." in text
    assert "No figure is clearly worse anywhere without: bone-lengths\n" in text


def runs_of(request):
    """Figures of a case by the mechanism that was off."""
    found = {}
    for row in measure_case(request):
        found.setdefault(row.pop("off"), []).append(row)
    return found


def test_what_is_off_changes_what_it_must_and_nothing_else():
    only = ["refinement", "lasting-errors", "confirmation", "votes"]
    runs = runs_of(TINY | {"only": [m.name for m in chosen(only)]})
    quality = {
        name: {key: value for key, value in figures.items() if key != "ms_per_frame"}
        for name, (figures,) in runs.items()
    }
    names = {m.name for m in chosen(["refinement"])} | {"confirmation"}  # votes need maps
    assert set(runs) == {DEFAULT} | names
    assert quality["lasting-errors"] == quality[DEFAULT]  # no biases are known
    assert quality["smoothing"]["acceleration_error"] > 2.0 * quality[DEFAULT]["acceleration_error"]
    assert quality["smoothing"]["mpjpe_mm"] > quality[DEFAULT]["mpjpe_mm"]
    assert all(figures["ms_per_frame"] > 0.0 for (figures,) in runs.values())


def test_votes_take_part_where_there_are_maps():
    request = TINY | {"scene": "three-views-2p+maps", "frames": 4, "only": ["votes"]}
    runs = runs_of(request)
    assert runs["votes"][0]["mpjpe_mm"] != runs[DEFAULT][0]["mpjpe_mm"]


def test_variants_of_a_scene():
    plain, few, unlisted = (
        simulated_world(f"noisy-4p5v{variant}", 3, 4) for variant in ("", "+2views", "+unlisted")
    )
    assert plain.rig.names[:2] == few.rig.names and not plain.mapped and not few.mapped
    for whole, part in zip(plain.sets, few.sets):
        assert [v.points.tobytes() for v in whole.views[:2]] == [v.points.tobytes() for v in part.views]
    views = [(a, b) for p, u in zip(plain.sets, unlisted.sets) for a, b in zip(p.views, u.views)]
    fewer = [len(whole.points) - len(part.points) for whole, part in views]
    assert set(fewer) == {0, 1} and np.mean(fewer) > 0.8
    for missing, (_, part) in zip(fewer, views):
        shown = part.maps.persons
        assert set(shown.tolist()) <= {-1, *range(len(part.points))} and missing == (shown == -1).any()


def test_the_truth_has_the_stamps_of_sets_whatever_the_clocks_are():
    for name in ("clean-4p5v", "mixed-rates", "own-clocks-3p5v"):
        world = simulated_world(name, 1, 12)
        stamps = np.array([frame.stamp_ns for frame in world.truth.frames])
        gaps = [int(np.abs(stamps - item.stamp_ns).min()) for item in world.sets]
        assert max(gaps) < 40_000_000, name


def test_who_is_in_the_maps_alone_is_found():
    request = TINY | {"scene": "noisy-4p5v+unlisted", "frames": 8, "only": ["lost-people"]}
    runs = runs_of(request)
    assert runs[DEFAULT][0]["recall"] > 95.0 and runs["lost-people"][0]["recall"] < 80.0


def test_people_who_are_to_be_ignored_do_not_count():
    found = simulated_world("occluded", 0, 45)
    hidden = [frame.ignored.any() for frame in found.truth.frames]
    assert not any(hidden[:30]) and all(hidden[30:45])


def test_a_folder_is_solved_like_the_simulation_that_it_holds(tmp_path):
    folder = tmp_path / "scene"
    assert main(["simulate", "three-views-2p", "--seed", "3", "--frames", "12", "--out", str(folder)]) == 0
    files = ["rig.json", "detections.json.gz", "truth.json.gz"]
    recorded, simulated = recorded_world([str(folder)]), simulated_world(*list(TINY.values()))
    assert recorded.stretches == 3 and recorded.names == simulated.names
    by_name = recorded_world([str(folder / name) for name in files])
    solutions = [solve(each, {}) for each in (recorded, by_name, simulated)]
    theirs, ours, expected = (
        figures_of(each.truth, solution)[0]
        for each, solution in zip((recorded, by_name, simulated), solutions)
    )
    for figure in FIGURES[:-1]:
        assert theirs[figure.key] == ours[figure.key] == pytest.approx(expected[figure.key], abs=1e-3)
    parts = figures_of(recorded.truth, solutions[0], recorded.stretches)
    assert len(parts) == 3
    assert np.mean([part["mpjpe_mm"] for part in parts]) == pytest.approx(theirs["mpjpe_mm"], rel=0.02)


def test_the_study_runs_in_processes_and_prints_json(capsys):
    options = ["--scenes", "three-views-2p", "--seeds", "7:9", "--frames", "4"]
    assert main(["study", "ablation", *options, "--only", "lag", "--jobs", "2", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["seeds"] == [7, 8] and [m["name"] for m in result["mechanisms"]] == ["lag"]
    assert [block["samples"] for block in result["scenes"]] == [1, 2]
    assert result["mechanisms"][0]["off"] == {"refinement": {"lag": 0.0}}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--only", "luck"], "--only luck"),
        (["--scenes", "moon"], "no scene 'moon'"),
        (["--scenes", "noisy-8p5v+moon"], "no scene 'noisy-8p5v+moon'"),
        (["--scenes", "rendered-3p8v+maps"], "no scene 'rendered-3p8v+maps'"),
        (["--scenes", ""], "nothing to solve"),
        (["--seeds", "2:2"], "'2:2': write FROM:TO"),
        (["--capture", "a", "b", "c", "d"], "--capture a b c d"),
        (["--scenes", "", "--capture", "nowhere"], "nowhere has no truth"),
    ],
)
def test_bad_input_is_told_in_one_line(options, told, capsys):
    assert main(["study", "ablation", *options]) == 2
    error = capsys.readouterr().err.strip()
    assert told in error and "\n" not in error


def test_a_cropped_case_has_narrower_images_without_the_joints_outside():
    whole, cropped = (simulated_world("three-views-2p", 3, 6, shares=shares) for shares in (None, HALF))
    for camera, narrow in zip(whole.rig.cameras, cropped.rig.cameras):
        assert narrow.image_size == (camera.image_size[0] // 2, camera.image_size[1])
    for item, cut in zip(whole.sets, cropped.sets):
        for view, part in zip(item.views, cut.views):
            left = view.image_size[0] // 4
            inside = (view.scores > 0.0) & (np.abs(view.points[..., 0] - 2 * left + 0.5) <= left)
            assert (part.scores > 0.0).sum() == inside.sum() > 0
            assert np.allclose(
                np.sort(part.points[part.scores > 0.0][:, 0]), np.sort(view.points[inside][:, 0]) - left
            )
    case = parsed("ablation", ["--scenes", "three-views-2p", "--seeds", "3", "--cropped"]).cases()[-1]
    assert case.title == "three-views-2p cropped" and case.request["shares"] == HALF
