"""Checks of the recogniser: `pytest training/test_recogniser.py`."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

import recogniser as r
import track_scenarios
from recogniser_interface import CHIP, CLASSES, FEATURES, STEPS

# On a busy machine a second thread is waited for longer than it helps.
torch.set_num_threads(1)

RUST = Path(__file__).resolve().parent.parent / "crates/models/src/tracking/recognition.rs"


def made(tracks: int = 40, per_track: int = 4, seed: int = 3) -> r.Tracks:
    """UAVs are steady squares, birds are bars that beat up and down."""
    rng = np.random.default_rng(seed)
    count = tracks * per_track
    labels = np.repeat(np.arange(tracks) % 2, per_track)
    chips = rng.integers(110, 130, (count * STEPS, CHIP, CHIP, 3)).astype(np.uint8)
    features = np.zeros((count, STEPS, len(FEATURES)), np.float32)
    features[:, :, r.AT["age_s"]] = np.linspace(-1, 0, STEPS)
    features[:, :, r.AT["sky_known"]] = 1
    features[:, :, r.AT["named_uav"]] = 1
    for n, label in enumerate(labels):
        for t in range(STEPS):
            chip = chips[n * STEPS + t]
            if label == 0:
                chip[8:16, 8:16] = 30
            else:
                up = int(4 * np.sin(2 * np.pi * (t / 5 + n / 7)))
                chip[11 + up : 14 + up, 2:22] = 30
    chips = np.concatenate([chips, np.zeros((1, CHIP, CHIP, 3), np.uint8)])
    index = np.arange(count * STEPS).reshape(count, STEPS)
    index[rng.random(index.shape) < 0.1] = -1
    features[index < 0] = 0
    track = np.repeat(np.arange(tracks), per_track)
    return r.Tracks(chips, index, features, labels, track, track // 4, np.full(count, 12.0, np.float32), np.full(count, -1), np.zeros(count, int))


def test_names_are_those_of_the_program():
    text = RUST.read_text()
    listed = re.search(r"FEATURES: \[&str; \d+\] = \[(.*?)\];", text, re.S).group(1)
    assert tuple(re.findall(r'"(\w+)"', listed)) == FEATURES
    named = re.search(r"ALL: \[Self; CLASSES\] = \[(.*?)\];", text, re.S).group(1)
    assert tuple(name.lower() for name in re.findall(r"Self::(\w+)", named)) == CLASSES
    assert f"STEPS: usize = {STEPS}" in text


def test_folders_are_read_and_damage_is_told(tmp_path):
    tracks = made(4, 2)
    folder = tmp_path / "run-1"
    folder.mkdir()
    np.save(folder / "chips.npy", tracks.chips[:-1])
    np.save(folder / "index.npy", tracks.index.astype(np.int32))
    np.save(folder / "features.npy", tracks.features)
    rows = [{"track": int(t), "object": "a", "class": CLASSES[c], "size_px": 12.0} for t, c in zip(tracks.track, tracks.labels)]
    sheet = {"features": list(FEATURES), "sequences": rows}
    (folder / "sequences.json").write_text(json.dumps(sheet))
    again, end = r.load([tmp_path])
    assert end == len(again)
    assert (again.index == tracks.index).all() and (again.labels == tracks.labels).all()
    assert (again.track == tracks.track).all() and (again.chips[-1] == 0).all()
    # One clip by two detectors is one run, but its tracks are two.
    copy = tmp_path / "run-2"
    shutil.copytree(folder, copy)
    assert set(r.load([tmp_path])[0].run) == {0, 1}
    for one in (folder, copy):
        (one / "sequences.json").write_text(json.dumps(sheet | {"clip": "V_BIRD_001", "split": "train"}))
    both, _ = r.load([tmp_path])
    assert set(both.run) == {0} and len(set(both.track)) == 2 * len(set(tracks.track)) and (both.source == r.REAL).all()
    both, end = r.load([folder], [copy])
    assert end == len(tracks) and len(both) == 2 * end
    (copy / "sequences.json").write_text(json.dumps(sheet | {"clip": "V_BIRD_002", "split": "val"}))
    assert (r.load([folder], [copy])[0].source[end:] == r.REAL_KEPT).all()
    assert (r.load([folder], [copy], all_clips=True)[0].source[end:] == r.REAL).all()
    with pytest.raises(SystemExit, match="no sequences.json below"):
        r.load([folder], [tmp_path / "nothing"])
    shutil.rmtree(copy)
    np.save(folder / "index.npy", tracks.index.astype(np.int32) + 9999)
    with pytest.raises(SystemExit, match="damaged"):
        r.load([tmp_path])
    (folder / "sequences.json").write_text(json.dumps(sheet | {"features": ["age_s"]}))
    with pytest.raises(SystemExit, match="not those of this version"):
        r.load([tmp_path])
    (folder / "sequences.json").write_text(json.dumps(sheet))
    np.save(folder / "chips.npy", tracks.chips[:-1, :12, :12])
    with pytest.raises(SystemExit, match="features or chips are not those of this version"):
        r.load([tmp_path])


def test_augmentation_keeps_what_it_must():
    tracks = made()
    rng = np.random.default_rng(1)
    chips, features, mask, labels = tracks.batch(np.arange(64))
    before = chips.numpy().copy()
    changed, f, m = r.augment(chips.numpy(), features, mask, labels, rng)
    assert (chips.numpy() == before).all() and changed.shape == before.shape and changed.dtype == np.uint8
    assert ((m == 0) | (m == 1)).all() and (m.sum(1) >= 3).all()
    assert (f[m == 0] == 0).all() and torch.isfinite(f).all()
    known = f[:, :, r.AT["sky_known"]]
    assert (f[..., r.MOTION][known == 0] == 0).all()


@pytest.mark.parametrize("box_px", [6.0, 12.0, 40.0])
def test_what_is_drawn_anew_is_as_large_as_the_boxes_and_in_the_middle(box_px, monkeypatch):
    monkeypatch.setattr(r.pictures, "background", lambda rng, size: np.full((size, size, 3), 100, np.float32))
    square = lambda rng, size, tone: (np.full((round(size), round(size), 4), (250, 250, 250, 1), np.float32), None, 0)
    seen = np.arange(16) % 2 == 0
    sizes = np.where(seen, box_px, 99.0)  # of a step that was not seen nothing is known
    rng = np.random.default_rng(5)
    found = [r.redrawn(square, sizes, seen, rng)[0][..., 0] > 175 for _ in range(20)]
    side = CHIP * box_px / max(2 * box_px, 16)
    assert np.sqrt(np.mean([step.sum() for chips in found for step in chips])) == pytest.approx(side, rel=0.1)
    y, x = np.mean([np.argwhere(step).mean(0) for chips in found for step in chips], 0)
    assert abs(y - (CHIP - 1) / 2) < 0.3 and abs(x - (CHIP - 1) / 2) < 0.3


def test_a_drawing_of_another_size_fits_the_boxes_and_tells_its_aspect(monkeypatch):
    monkeypatch.setattr(r.pictures, "background", lambda rng, size: np.full((size, size, 3), 100, np.float32))

    def bar(rng, size, tone):  # half as long as it should be, in the corner of its drawing
        drawing = np.zeros((40, 60, 4), np.float32)
        drawing[5:15, 2:22] = (250, 250, 250, 1)
        return drawing, np.array([2, 5, 22, 15], np.float32), 0

    rng = np.random.default_rng(5)
    chips, aspects = zip(*(r.redrawn(bar, np.full(16, 40.0), np.ones(16, bool), rng) for _ in range(20)))
    assert aspects == pytest.approx([np.log(2)] * 20)
    found = [step for chip in chips for step in chip[..., 0] > 175]
    assert np.sqrt(np.mean([step.sum() for step in found])) == pytest.approx(CHIP / 2 / np.sqrt(2), rel=0.1)
    y, x = np.mean([np.argwhere(step).mean(0) for step in found], 0)
    assert abs(y - (CHIP - 1) / 2) < 0.3 and abs(x - (CHIP - 1) / 2) < 0.3


def test_what_has_another_tone_stands_where_it_stood():
    rng = np.random.default_rng(2)
    chips = np.full((STEPS, CHIP, CHIP, 3), (90, 120, 150), np.uint8)
    chips[:, 9:15, 9:15] = (40, 60, 110)
    seen = set()
    for _ in range(60):
        other = r.retoned(chips, rng)
        assert (other[:, :8] == chips[:, :8]).all()
        thing = other[:, 9:15, 9:15].astype(int)
        assert (thing == thing[:1, :1, :1]).all()
        seen.add(int(np.sign(thing[0, 0, 0, 1] - 120)))
    assert seen == {-1, 1}


def test_stretching_time_keeps_the_newest_and_scales_rates():
    tracks = made()
    chips, features, mask, _ = tracks.batch(np.array([0]))
    features[:] = 0.5
    mask[:] = 1
    pictures, f, m = chips.numpy()[0].copy(), features[0].clone(), mask[0].clone()
    r.stretch(pictures, f, m, 2.0)
    assert (pictures[-1] == chips[0, -1].numpy()).all() and (pictures[-2] == chips[0, -3].numpy()).all()
    assert m.tolist() == [0] * 8 + [1] * 8
    assert np.isclose(f[0, r.AT["rate_up"]], np.arcsinh(2 * np.sinh(0.5)))


def test_the_measures_have_their_closed_forms():
    p = np.array([0.1] * 10 + [0.9] * 10)
    truth = np.array([1] + [0] * 9 + [1] * 8 + [0] * 2)
    rows = r.reliability(p, truth, np.full(20, 0.05))
    assert [(round(x["p"], 3), round(x["share"], 3), round(x["weight"], 3)) for x in rows] == [(0.1, 0.1, 0.5), (0.9, 0.8, 0.5)]
    # Overconfident by a known temperature.
    g = torch.Generator().manual_seed(1)
    logits = torch.randn(20_000, len(CLASSES), generator=g) * 2
    labels = torch.multinomial(torch.softmax(logits, 1), 1, generator=g)[:, 0].numpy()
    found = r.temperature_of(3 * logits, labels, np.full(20_000, 1 / 20_000))
    assert abs(found - 3) < 0.15
    tracks = made(8, 2)
    right = np.eye(len(CLASSES))[tracks.labels]
    report = r.measures(right, tracks)
    assert report["brier"] == 0 and report["uav_recall"] == 1 and report["false_uav"]["bird"] == 0
    assert report["confusion"]["bird"]["bird"] == 1 and report["by_size"][2]["sequences"] == 16
    wrong = r.measures(np.eye(len(CLASSES))[1 - tracks.labels], tracks)
    assert wrong["brier"] == 2 and np.isclose(wrong["brier_uav"], 1)


def test_it_learns_exports_and_keeps_to_its_size(tmp_path):
    tracks = made()
    model = r.train(tracks, 120, 32, 3e-3, 1, None, [])
    assert sum(x.numel() for x in model.parameters()) < 100_000
    fresh = made(seed=9)
    right = r.logits_of(model, fresh).argmax(1).numpy() == fresh.labels
    assert right.mean() > 0.9
    graph = r.to_onnx(model, 1.3, {})
    assert r.compare(model, 1.3, graph, fresh) < 1e-4
    # What was not seen must not count.
    chips, features, mask, _ = fresh.batch(np.arange(8))
    mask[:, 4:9] = 0
    features[:, 4:9] = 0
    other = chips.clone()
    other[:, 4:9] = 255
    ask = lambda c: r.session(graph).run(None, {"chips": r.planes(c).numpy(), "features": features.numpy(), "mask": mask.numpy()})[0]
    assert np.abs(ask(chips) - ask(other)).max() < 1e-5
    path = tmp_path / "reliability.svg"
    r.plot.reliability(r.measures(torch.softmax(r.logits_of(model, fresh), 1).numpy(), fresh)["reliability_uav"], path, "test")
    assert "PathCollection_1" in path.read_text()  # the bins


def test_an_ensemble_is_the_mean_of_its_members():
    tracks = made(12, 2)
    both, log = r.ensemble(tracks, range(3, 5), 4, 16, 3e-3, 2)
    assert [row["seed"] for row in log] == [3, 4]
    alone = [r.logits_of(r.train(tracks, 4, 16, 3e-3, seed, None, []), tracks) for seed in (3, 4)]
    assert torch.allclose(r.logits_of(both, tracks), sum(alone) / 2, atol=1e-5) and not torch.allclose(*alone)


def test_company_stays_in_the_precise_field():
    number = r"(-?[\d.]+(?:e-?\d+)?)"
    vector = rf"\[{number}, {number}, {number}\]"
    read = lambda text: [np.array([float(x) for x in found]) for found in re.findall(vector, text)]
    rng = track_scenarios.random.Random(5)
    beside = {1.0: 0, 4.0: 0}
    for _ in range(500):
        wider = rng.choice(list(beside))
        ifov_rad = wider * track_scenarios.FINE_IFOV_RAD
        az, el = rng.uniform(0, 360), rng.uniform(1, 12) if wider == 1 else rng.uniform(*track_scenarios.FROM_BELOW_DEG)
        held, _, rates = track_scenarios.crossing(rng, rng.choice(("uav", "bird")), az, el, ifov_rad)
        found = track_scenarios.companion(rng, "beside", az, el, rates, ifov_rad)
        if found is None:
            continue
        beside[wider] += 1
        # One second on, in units of the precise camera's field of 17 by 13 mrad.
        bearings = []
        for text in (held, found[0]):
            at, *moves = read(text)
            at = at + (moves[0] if moves else 0) - [0, 0, track_scenarios.STATION_UP_M]
            bearings.append([np.arctan2(at[0], at[1]), np.arcsin(at[2] / np.linalg.norm(at))])
        apart = np.array(bearings[1]) - bearings[0]
        apart[0] = np.angle(np.exp(1j * apart[0])) * np.cos(bearings[0][1])
        assert np.abs(apart).max() < 0.02 * wider, (held, found)
    assert min(beside.values()) > 50


def test_scenarios_are_drawn_from_their_seeds():
    one = track_scenarios.scenario(7, 5.0)
    assert one == track_scenarios.scenario(7, 5.0) != track_scenarios.scenario(8, 5.0)
    held = {re.search(r'description = "(\w+) held,', track_scenarios.scenario(s, 5.0)).group(1) for s in range(60)}
    assert held == {"nothing", *track_scenarios.HELD}
    from_below = [track_scenarios.tomllib.loads(track_scenarios.scenario(s, 5.0, ("helicopter",), 1.0)) for s in range(20)]
    for made in from_below:
        assert made["description"].startswith("helicopter held") and made["search"]["elevation_deg"] >= 12
        # It flies level in a camera that is wider than the station's own.
        moves = next(thing for thing in made["distractors"] if thing["name"] == "held")["trajectory"]
        assert abs(moves.get("velocity_enu_mps", [0, 0, 0])[2]) <= 0.08 * 60
        assert made["station"]["cameras"]["precise"]["hfov_deg"] >= 2


@pytest.mark.parametrize("options", [("--keep", "0.5"), ("--keep", "0", "1.5", "--init", "x.onnx")])
def test_shares_that_cannot_be_kept_are_told(options, monkeypatch):
    monkeypatch.setattr("sys.argv", ["recogniser.py", "--data", "none", "--out", "none", *options])
    with pytest.raises(SystemExit, match="from 0 to 1, and --init"):
        r.main()


def test_a_file_gives_back_its_models():
    tracks = made(12, 2)
    both, _ = r.ensemble(tracks, range(3, 5), 4, 16, 3e-3, 1)
    graph = r.to_onnx(both, 1.0, {})
    again = r.Ensemble(r.of_file(r.onnx.load_from_string(graph))).eval()
    assert torch.allclose(r.logits_of(again, tracks), r.logits_of(both, tracks), atol=1e-5)
    # It goes on learning from there, in the scale of its features.
    on, _ = r.ensemble(tracks, range(3, 5), 1, 16, 1e-6, 1, again.members)
    assert torch.allclose(r.logits_of(on, tracks), r.logits_of(both, tracks), atol=1e-2)
    # What keeps all of its beginning has learned nothing; the share that errs least is kept.
    learned, _ = r.ensemble(tracks, range(3, 5), 40, 16, 3e-3, 1, again.members)
    kept, _, scores = r.keeping(learned, again.members, [1.0], tracks)
    assert torch.allclose(r.logits_of(kept, tracks), r.logits_of(again, tracks), atol=1e-6)
    best, temperature, more = r.keeping(learned, again.members, [0.0, 0.5, 1.0], tracks)
    assert list(more) == [0.0, 0.5, 1.0] and more[1.0] == scores[1.0] and min(more.values()) < scores[1.0]
    p = torch.softmax(r.logits_of(best, tracks) / temperature, 1).numpy()
    assert np.mean([part["brier_uav"] for part in r.measures(p, tracks)["by_source"].values()]) == pytest.approx(min(more.values()))
    half, own = r.blended(on.members[0], again.members[0], 0.5), on.members[0]
    assert torch.allclose(half.step.bias, 0.5 * (own.step.bias + again.members[0].step.bias), atol=1e-7)
    p = r.answers(graph, tracks)
    assert np.allclose(p, torch.softmax(r.logits_of(both, tracks), 1).numpy(), atol=1e-5)


def test_engagements_become_scenarios_for_tracks():
    drawn = (
        'seed = {}\nduration_s = 25.0\n[city]\nseed = {}\n[engage]\nmin_clear_range_m = 20.0\n[[uavs]]\nname = "intruder"\n'
        '[uavs.trajectory]\nkind = "straight"\nstart_enu_m = [300.0, 400.0, 60.0]\nvelocity_enu_mps = [8.0, 0.0, 0.0]\n'
        '[[distractors]]\nname = "gull"\n'
    )
    made = [track_scenarios.tomllib.loads(track_scenarios.of_drawn(drawn.format(seed, 9), 4.0)) for seed in range(60)]
    assert all(s["duration_s"] == 4.0 and s["engage"]["authorised"] is False and "precise" in s["station"]["cameras"] for s in made)
    held = [s["operator"][0]["designate"] if "operator" in s else None for s in made]
    assert set(held) == {None, "intruder", "gull"} and 20 < held.count(None) < 40
    beside = [thing for s in made for thing in s["uavs"] + s["distractors"] if thing["name"].startswith("beside")]
    assert {"model" in thing for thing in beside} == {False, True}
    path = made[0]["uavs"][0]["trajectory"]
    for other in (thing["trajectory"] for thing in beside):
        assert other | {"start_enu_m": path["start_enu_m"]} == path
        # At half a kilometre, in a field of 8.7 by 6.5 m.
        assert 0 < np.abs(np.array(other["start_enu_m"]) - path["start_enu_m"]).max() < 2.1
    assert track_scenarios.of_drawn(drawn.format(1, track_scenarios.ONCE_JUDGED_CITIES[0]), 4.0) is None


def test_kept_clips_are_test_alone_and_real_ones_are_half_of_a_class():
    one = made(24)
    one.source[:] = np.where(one.run == 0, r.REAL_KEPT, np.where(one.run == 1, r.REAL, r.RENDERED))
    learn, calibrate, test = r.split(one, len(one), 0.2, 1)
    for part in (learn, calibrate):
        assert not (part.source == r.REAL_KEPT).any()
    assert set(one.run[one.source == r.REAL_KEPT]) <= set(test.run)
    # Of what is to learn from alone, kept clips and runs that are measured on are left out; nothing of it is measured on.
    twice = one.only(np.concatenate([np.arange(len(one)), np.arange(len(one))]))
    more, *measured = r.split(twice, len(one), 0.2, 1)
    assert len(more) == 2 * len(learn) and [len(part) for part in measured] == [len(calibrate), len(test)]
    weights = r.sampling_weights(one.only(one.source != r.REAL_KEPT))
    kept = one.only(one.source != r.REAL_KEPT)
    for label in set(kept.labels):
        shares = [weights[(kept.labels == label) & (kept.source == source)].sum() for source in (r.RENDERED, r.REAL)]
        assert min(shares) == 0 or abs(shares[0] - shares[1]) < 1e-12
