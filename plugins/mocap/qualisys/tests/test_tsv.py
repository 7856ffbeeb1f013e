"""QTM's 6DOF files, written here as QTM writes them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vrbench_qualisys.tsv import IMPORTER, Options

from vrbench.errors import DataError
from vrbench.geometry import relative_angle

N = 30
RNG = np.random.default_rng(3)
P = np.array([0.2, -0.4, 1.3]) + np.cumsum(RNG.normal(0, 0.01, (N, 3)), axis=0)
TURNS = Rotation.from_rotvec(np.cumsum(RNG.normal(0, 0.05, (N, 3)), axis=0))
AXES = ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{i}]" for i in range(9))]


def export(*, bodies=("headset",), lost=(), blank=(), numbered=True, stamp="2024-01-31, 13:00:50"):
    lines = [f"NO_OF_FRAMES\t{N}", "NO_OF_CAMERAS\t8", f"NO_OF_BODIES\t{len(bodies)}"]
    lines += ["FREQUENCY\t100", "NO_OF_ANALOG\t0", "ANALOG_FREQUENCY\t0", "DESCRIPTION\t--"]
    lines += [f"TIME_STAMP\t{stamp}\t22107.99179716", "DATA_INCLUDED\t6D"]
    lines += ["\t".join(["BODY_NAMES", *bodies])]
    titles = [f"{name} {AXES[0]}\t" + "\t".join(AXES[1:]) for name in bodies]
    lines.append("\t".join([*(["Frame", "Time"] if numbered else []), *titles]) + "\t")
    for i in range(N):
        cells = [str(i + 1), f"{i / 100:.5f}"] if numbered else []
        for name in bodies:
            if name != "headset":
                cells += ["0.00000"] * 6 + ["0.5"] + [f"{x:.5f}" for x in np.eye(3).ravel()]
            elif i in lost:
                cells += ["0.00000"] * 6 + ["-1.00000"] + ["0.00000"] * 9
            elif i in blank:
                cells += [""] * 16
            else:
                turn = TURNS[i].as_matrix().T.ravel()
                cells += [f"{x:.5f}" for x in (*P[i] * 1e3, 0, 0, 0, 0.4, *turn)]
        lines.append("\t".join(cells) + "\t")
    return "".join(f"{line}\r\n" for line in lines)


@pytest.fixture
def read(tmp_path):
    def read_text(text, **options):
        path = tmp_path / "take_6D.tsv"
        path.write_text(text, encoding="utf-8", newline="")
        return IMPORTER.read(path, Options(**{"up": "y", **options}))

    return read_text


@pytest.mark.parametrize("numbered", [True, False])
@pytest.mark.parametrize("bodies", [("headset",), ("controller", "headset"), ("headset", "b 2")])
def test_the_bodys_poses_are_read(read, numbered, bodies):
    imported = read(export(numbered=numbered, bodies=bodies), body="headset", utc_offset="+01:00")
    samples = imported.samples
    np.testing.assert_allclose(samples.pose.p, P, atol=1e-8)
    assert relative_angle(samples.pose.q, TURNS.as_quat()).max() < 2e-5
    assert samples.pose_t[0] == 1_706_702_450 * 10**9
    assert np.diff(samples.pose_t).tolist() == [10**7] * (N - 1)
    assert imported.repairs == ()


def test_a_real_rows_matrix_agrees_with_its_angles(read):
    """The first row of a public export (shiplab/dt_cv): small turns, whose sine is the angle."""
    head = export().split("\r\n")[:11]
    row = "1\t0.0\t-194.9\t2.2\t0.99\t-0.65630\t0.09391\t0.05772\t4.98\t1.00000\t0.00099\t-0.00165"
    row += "\t-0.00101\t0.99993\t-0.01145\t0.00164\t0.01145\t0.99993\t"
    samples = read("\r\n".join([*head, row]) + "\r\n").samples
    angles = np.degrees(Rotation.from_quat(samples.pose.q[0]).as_rotvec())
    np.testing.assert_allclose(angles, [-0.6563, 0.09391, 0.05772], atol=2e-3)


def test_lost_and_blank_frames_are_invalid(read):
    samples = read(export(lost=(0, 5, 6), blank=(9,))).samples
    assert len(samples) == N
    assert np.flatnonzero(~samples.good).tolist() == [0, 5, 6, 9]


def test_z_up_is_the_default(read):
    samples = read(export(), up="z").samples
    np.testing.assert_allclose(samples.pose.p, P[:, [0, 2, 1]] * [1, 1, -1], atol=1e-8)


@pytest.mark.parametrize(
    ("change", "options", "says"),
    [
        (lambda s: "", {}, "is empty"),
        (lambda s: "a\tb\n1\t2\n", {}, "has no line of column names"),
        (lambda s: s, {"body": "hmd"}, r"no body 'hmd' \(there are headset\)"),
        (lambda s: export(bodies=("a", "headset")), {}, "which body is meant"),
        (lambda s: s.replace("Rot[4]", "Turn"), {}, r"no column Rot\[4\]"),
        (lambda s: s.replace("FREQUENCY\t100", "FREQUENCY\t0"), {}, "FREQUENCY: gives no rate"),
        (lambda s: s.replace("\n3\t0.02000\t", "\n3\t0.02000\tx"), {}, "line 14: has a cell"),
        (lambda s: "\r\n".join(s.split("\r\n")[:11]) + "\r\n", {}, "holds no frames"),
        (lambda s: export(lost=range(N)), {}, "seen in no frame"),
    ],
)
def test_what_is_wrong_is_named(read, change, options, says):
    with pytest.raises(DataError, match=rf"take_6D\.tsv: .*{says}"):
        read(change(export()), **options)
