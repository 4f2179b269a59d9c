"""The picture of the study of cameras and IMUs has all lines, and is the same every time."""

from panoptic_ros.view.body_study_plot import PANELS, body_study_plot


def rows():
    return [
        {"cameras": c, "imus": i, "method": method}
        | {
            key + end: worse * (300.0 / (1 + c) - i) * (1.0 if "m" in end[:2] or not end else 0.5)
            for key in PANELS
            for end in ("", "_median", "_std", "_mad")
        }
        for c in (0, 2, 8)
        for i in (0, 6, 13)
        for method, worse in (("ours", 1.0), ("paper", 1.5))
        if c or i
    ]


def test_equal_rows_give_equal_pictures():
    picture = body_study_plot(rows(), "ours")
    assert picture.startswith(b"\x89PNG") and picture == body_study_plot(rows(), "ours")
    assert picture != body_study_plot([row for row in rows() if row["imus"]], "ours")
