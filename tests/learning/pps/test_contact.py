"""Contact model: simulated trials whose answer is known, and distributions whose true probability is."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED
from scipy.special import expit
from scipy.stats import beta, multivariate_normal, multivariate_t
from sklearn.gaussian_process.kernels import RBF
from trials_made_up import approach, session

from learning.pps.contact import (
    Paths,
    SessionPaths,
    _features,
    _of_paths,
    _offsets,
    displacements,
    learn_contact,
    predict_contact,
    predict_session,
)
from learning.pps.scores import auroc
from learning.pps.trials import Trial, touch_rates

HORIZON_S = 0.15


def test_paths_over_different_taxels_are_distinguished():
    rng = np.random.default_rng(SEED)
    training, trials = session(rng, 16), session(rng, 16)
    found = predict_contact(HORIZON_S, learn_contact(HORIZON_S, training), trials).probability
    touched = np.array([trial.touched for trial in trials])
    assert auroc(touched[:, :2], found[:, :2]) == 1
    assert (found[:, 2] < 0.1).all(), "never touched"


def test_paths_without_information_get_about_the_rate_of_touch():
    rng = np.random.default_rng(SEED)
    aims = rng.permutation([0] * 120 + [1] * 40)
    trials = [replace(approach(rng, 0, beside_m=0.015), touched=np.arange(3) == aim) for aim in aims]
    found = predict_contact(HORIZON_S, learn_contact(HORIZON_S, tuple(trials[:80])), tuple(trials[80:])).probability
    np.testing.assert_allclose(found.mean(axis=0), touch_rates(tuple(trials[:80])), atol=0.15)


def test_a_trial_out_of_reach_gets_the_rate_of_touch_and_is_marked():
    trials = list(session(np.random.default_rng(1), 8))
    far = replace(trials[0], d_m=trials[0].d_m + np.array([0, 0, 1.0]))
    learned = learn_contact(HORIZON_S, tuple(trials))
    found = predict_contact(HORIZON_S, learned, (far, trials[1]))
    np.testing.assert_allclose(found.probability[0], [4.5 / 9, 4.5 / 9, 0.5 / 9])
    np.testing.assert_array_equal(found.in_reach, [[False] * 3, [True] * 3])
    never_near = predict_contact(HORIZON_S, learn_contact(HORIZON_S, (far, far, trials[1])), (trials[2],))
    assert np.isfinite(never_near.probability).all()
    nothing = predict_contact(HORIZON_S, learn_contact(HORIZON_S, (far, far)), (trials[2],))
    assert not nothing.in_reach.any()
    np.testing.assert_allclose(nothing.probability[0], [2.5 / 3, 0.5 / 3, 0.5 / 3])
    assert (nothing.lower[0, 0], nothing.upper[0, 0]) == pytest.approx(beta(2.5, 0.5).interval(0.9))
    once = predict_contact(HORIZON_S, learn_contact(HORIZON_S, (far,)), (trials[2],))
    np.testing.assert_allclose(once.probability[0], [1.5 / 2, 0.5 / 2, 0.5 / 2])


def test_unknown_samples_are_left_out():
    trials = session(np.random.default_rng(7), 8)
    holes = [replace(trial, d_m=trial.d_m.copy()) for trial in trials]
    for trial in holes:
        trial.d_m[-3] = np.nan  # the last but one that is known
    full, some = (predict_contact(HORIZON_S, learn_contact(HORIZON_S, tuple(t)), tuple(t)) for t in (trials, holes))
    assert some.in_reach.all()
    np.testing.assert_allclose(some.probability, full.probability, atol=0.1)


def _world(rng, n, rate, apart_m, sd_m):
    """Displacements of two Gaussian kinds of path at one taxel, as trials of three samples."""
    touched = rng.random(n) < rate
    u = np.array([0.01, -0.02, 0.03]) + np.where(touched[:, None], apart_m, 0.0) + rng.normal(0, sd_m, (n, 3))
    stamps = np.array([0.0, 0.1, 0.2, 0.5])
    return [
        Trial(stamps, np.tile(x, (4, 1, 1)), np.zeros((4, 1, 3)), np.array([y]))
        for x, y in zip(u, touched, strict=True)
    ]


def _truth(trials, rate, apart_m, sd_m):
    at = np.array([trial.d_m[0, 0] for trial in trials]) - np.array([0.01, -0.02, 0.03])
    hit = rate * multivariate_normal(apart_m, sd_m**2 * np.eye(3)).pdf(at)
    miss = (1 - rate) * multivariate_normal(np.zeros(3), sd_m**2 * np.eye(3)).pdf(at)
    return hit / (hit + miss)


@pytest.mark.parametrize("horizon_s", [-0.1, np.nan])
def test_an_impossible_horizon_is_refused(horizon_s: float):
    with pytest.raises(ValueError, match=r"horizon of .*: expected 0 or more"):
        learn_contact(horizon_s, session(np.random.default_rng(SEED), 3))


def moved(trials: tuple[Trial, ...], by_m: float) -> tuple[Trial, ...]:
    return tuple(replace(trial, d_m=trial.d_m + np.array([by_m, 0, 0])) for trial in trials)


def test_another_session_is_predicted_in_spite_of_its_offset():
    """Taxels 3 cm apart, frames displaced by as much: paths to one pass where those to the other did.  The mean of
    the paths gives the offset, better with every trial."""
    rng = np.random.default_rng(SEED)
    learned, other = learn_contact(HORIZON_S, session(rng, 24)), session(rng, 40)
    touched = np.array([trial.touched for trial in other])[:, :2]
    wrong = predict_contact(HORIZON_S, learned, moved(other, 0.03)).probability[:, :2]
    found = predict_session(HORIZON_S, learned, moved(other, 0.03)).probability[:, :2]
    assert auroc(touched, wrong) < 0.9
    assert auroc(touched[20:], found[20:]) > 0.99


def test_a_session_without_an_offset_is_predicted_about_as_well():
    rng = np.random.default_rng(SEED)
    learned, other = learn_contact(HORIZON_S, session(rng, 24)), session(rng, 40)
    touched = np.array([trial.touched for trial in other])[:, :2]
    assert auroc(touched, predict_session(HORIZON_S, learned, other).probability[:, :2]) > 0.99


def test_later_trials_of_a_session_do_not_change_earlier_predictions():
    rng = np.random.default_rng(SEED)
    learned, other = learn_contact(HORIZON_S, session(rng, 12)), session(rng, 6)
    far = moved(other, 0.5)  # out of reach: says nothing of the session
    whole = predict_session(HORIZON_S, learned, (far[0], *other[:3], *moved(other[3:], 0.02)))
    first = predict_session(HORIZON_S, learned, (far[0], *other[:3]))
    np.testing.assert_allclose(whole.probability[:4], first.probability, rtol=1e-12)  # sums round by where arrays lie
    alone = predict_contact(HORIZON_S, learned, far[:1]).probability
    np.testing.assert_allclose(whole.probability[:1], alone, rtol=1e-12)


def test_where_all_paths_are_alike_the_touches_alone_count():
    """Three touches in seven equal trials: the beta distribution with Jeffreys' prior, its mean and its interval, and
    no evidence for one of the 17 hypotheses by which paths matter, which have a fifth together."""
    path = approach(np.random.default_rng(SEED), 0)
    one = replace(path, d_m=path.d_m[:, :1])
    trials = tuple(replace(one, touched=np.array([k < 3])) for k in range(7))
    learned = learn_contact(HORIZON_S, trials)
    assert learned.weights == pytest.approx([0.8] + [0.2 / 17] * 17)
    found = predict_contact(HORIZON_S, learned, trials[:1])
    assert found.probability[0, 0] == pytest.approx(3.5 / 8)
    assert (found.lower[0, 0], found.upper[0, 0]) == pytest.approx(beta(3.5, 4.5).interval(0.9))


def test_a_session_after_trials_that_never_came_near_is_predicted_as_it_is():
    rng = np.random.default_rng(SEED)
    learned, other = learn_contact(HORIZON_S, moved(session(rng, 3), 0.5)), session(rng, 2)
    found = predict_session(HORIZON_S, learned, other)
    np.testing.assert_allclose(found.probability, predict_contact(HORIZON_S, learned, other).probability, rtol=1e-12)


def test_the_displacement_is_the_mean_of_those_of_the_last_three_samples_known_that_are_in_reach():
    height = np.array([0.30, 0.19, 0.18, 0.25, 0.17, 0.13, 0.02, 0.01])
    d = np.zeros((8, 1, 3))
    d[:, 0, 2] = height
    trial = Trial(0.1 * np.arange(8), d, np.zeros_like(d), np.array([True]))
    found = displacements(0.2, (trial,))  # the sample at 0.5 s is known
    np.testing.assert_allclose(found.u_m, [[[0, 0, np.mean([0.17, 0.13])]]])
    assert not found.lost.any()


def test_far_away_and_lost_are_told_apart():
    """Last seen 0.3 m away; last seen near, 0.5 s before the horizon; never seen."""
    near = approach(np.random.default_rng(SEED), 0)
    gone, never = (replace(near, d_m=near.d_m.copy()) for _ in range(2))
    gone.d_m[-7:], never.d_m[:] = np.nan, np.nan
    far = replace(near, d_m=near.d_m + np.array([0, 0, 0.3]))
    found = displacements(HORIZON_S, (near, far, gone, never))
    assert found.lost[:, 0].tolist() == [False, False, True, True]
    assert found.in_reach[:, 0].tolist() == [True, False, False, False]


@pytest.mark.parametrize(("age_s", "lost"), [(0.2, False), (0.4, True)])
def test_a_path_is_lost_0_3_s_after_it_was_last_seen(age_s: float, lost: bool):
    d = np.tile([0.0, 0.0, 0.05], (11, 1, 1))
    d[11 - round(age_s / 0.1) :] = np.nan
    trial = Trial(0.1 * np.arange(11), d, np.zeros_like(d), np.array([True]))
    assert displacements(0.0, (trial,)).lost.tolist() == [[lost]]


def test_trials_that_are_lost_are_predicted_from_those_that_were_lost():
    """40 paths touch every time, 40 that get lost never do, and 40 that stay far away every other time."""
    rng = np.random.default_rng(SEED)
    near = [replace(approach(rng, 0), touched=np.ones(3, bool)) for _ in range(40)]
    lost = [
        replace(t, d_m=t.d_m + np.where(t.stamps_s > 1, np.nan, 0)[:, None, None], touched=~t.touched) for t in near
    ]
    far = [replace(t, d_m=t.d_m + 1.0, touched=np.full(3, k % 2 == 0)) for k, t in enumerate(near)]
    learned = learn_contact(HORIZON_S, (*near, *lost, *far))
    found = predict_contact(HORIZON_S, learned, (near[0], lost[0], far[0]))
    p = found.probability[:, 0]
    assert p[0] > 0.85
    assert p[1] < 0.3
    assert p[2] == pytest.approx(0.5, abs=0.05)
    assert (found.lower[2, 0], found.upper[2, 0]) == pytest.approx(beta(30.5, 30.5).interval(0.9))


def test_a_trial_in_reach_of_some_taxels_only_says_nothing_about_the_session():
    rng = np.random.default_rng(SEED)
    training, other = session(rng, 9), session(rng, 4)
    partly = replace(training[0], d_m=training[0].d_m + np.array([[0.0, 0, 0], [0, 0, 1.0], [0, 0, 1.0]]))
    learned = learn_contact(HORIZON_S, training)
    after = predict_session(HORIZON_S, learned, (partly, *other)).probability[1:]
    np.testing.assert_allclose(after, predict_session(HORIZON_S, learned, other).probability, rtol=1e-12)


def test_trials_out_of_reach_do_not_change_those_in_reach():
    """Paths that end on a taxel half of the time, by a model that has also seen hundreds pass far away."""
    rng = np.random.default_rng(SEED)
    near = tuple(approach(rng, i % 2) for i in range(60))
    far = tuple(replace(one, d_m=one.d_m + np.array([0, 0, 1.0]), touched=np.zeros(3, bool)) for one in near * 5)
    alone, among = (predict_contact(HORIZON_S, learn_contact(HORIZON_S, of), near[:20]) for of in (near, (*near, *far)))
    np.testing.assert_allclose(among.probability, alone.probability, atol=0.1)
    away = predict_contact(HORIZON_S, learn_contact(HORIZON_S, (*near, *far)), far[:1])
    assert (away.probability[0] < 0.04).all()


@pytest.mark.parametrize("horizon_s", [0.15, 0.4])
def test_nothing_later_than_the_horizon_is_used(horizon_s):
    trials = session(np.random.default_rng(2), 8)

    def changed(trial: Trial, from_s: float) -> Trial:
        late = trial.stamps_s > trial.stamps_s[-1] - from_s
        return replace(trial, d_m=np.where(late[:, None, None], 0.02, trial.d_m))

    after = tuple(changed(trial, horizon_s) for trial in trials)
    before = tuple(changed(trial, horizon_s + 0.11) for trial in trials)
    expected = predict_contact(horizon_s, learn_contact(horizon_s, trials), trials).probability
    found = predict_contact(horizon_s, learn_contact(horizon_s, after), after).probability
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert not np.allclose(predict_contact(horizon_s, learn_contact(horizon_s, trials), before).probability, expected)
    assert not np.allclose(predict_contact(horizon_s, learn_contact(horizon_s, before), trials).probability, expected)


def test_a_common_offset_changes_nothing():
    rng = np.random.default_rng(3)
    trials, others = session(rng, 9), session(rng, 4)
    expected = predict_contact(HORIZON_S, learn_contact(HORIZON_S, trials), others)
    shifted = predict_contact(HORIZON_S, learn_contact(HORIZON_S, moved(trials, 0.02)), moved(others, 0.02))
    np.testing.assert_allclose(shifted.probability, expected.probability, rtol=1e-6)


def test_intervals_hold_the_probability_and_narrow_with_trials():
    rng = np.random.default_rng(4)
    others, widths = session(rng, 6, beside_m=0.03), []
    for n in (10, 40, 160):
        found = predict_contact(HORIZON_S, learn_contact(HORIZON_S, session(rng, n, beside_m=0.03)), others)
        assert ((found.lower >= 0) & (found.lower < found.probability)).all()
        assert ((found.probability < found.upper) & (found.upper <= 1)).all()
        widths.append((found.upper - found.lower)[:, :2].mean())
    assert widths[0] > 1.2 * widths[1] > 1.5 * widths[2]


def test_one_trial_is_not_certainty():
    rng = np.random.default_rng(5)
    found = predict_contact(HORIZON_S, learn_contact(HORIZON_S, (approach(rng, 0),)), (approach(rng, 0),))
    assert found.probability[0, 0] == pytest.approx(0.75, abs=0.01)
    assert found.lower[0, 0] < 0.5


def test_with_many_trials_it_is_bayes_rule(monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(SEED)
    world = 0.3, np.array([0.01, -0.006, 0.0]), 0.01
    monkeypatch.setattr("learning.pps.contact._FREEDOM", 1e6)
    seen, new = _world(rng, 4000, *world), _world(rng, 50, *world)
    found = predict_contact(HORIZON_S, learn_contact(HORIZON_S, tuple(seen)), tuple(new)).probability[:, 0]
    np.testing.assert_allclose(found, _truth(new, *world), atol=0.08)


def test_paths_move_a_prediction_only_as_far_as_they_have_been_shown_to_matter():
    """The same paths with their own outcomes and with those of other trials."""
    rng = np.random.default_rng(SEED)
    trials = session(rng, 40, beside_m=0.008)
    dealt = [replace(t, touched=trials[k].touched) for t, k in zip(trials, rng.permutation(40), strict=True)]
    shown, not_shown = learn_contact(HORIZON_S, trials), learn_contact(HORIZON_S, tuple(dealt))
    assert shown.weights[0] < 0.01
    assert not_shown.weights[0] > 0.5
    p = predict_contact(HORIZON_S, not_shown, session(rng, 20)).probability
    np.testing.assert_allclose(p, np.tile(touch_rates(tuple(dealt)), (20, 1)), atol=0.15)


def test_what_holds_only_within_a_part_of_the_session_is_not_shown():
    """Aims move by 4 cm with every quarter of the session, and touches change with the quarter, not with the path."""
    rng = np.random.default_rng(SEED)
    trials = []
    for quarter, rate in enumerate((0.9, 0.1, 0.8, 0.2)):
        for _ in range(10):
            one = approach(rng, 0, beside_m=0.008)
            d = one.d_m + np.array([0.04 * quarter, 0, 0])
            trials.append(replace(one, d_m=d, touched=np.full(3, rng.random() < rate)))
    assert learn_contact(HORIZON_S, tuple(trials)).weights[0] > 0.5


def test_a_wild_path_changes_little():
    rng = np.random.default_rng(6)
    trials, others = session(rng, 24), session(rng, 8)
    wild = replace(trials[5], d_m=trials[5].d_m + np.array([0.12, -0.1, 0.0]))
    with_it = predict_contact(HORIZON_S, learn_contact(HORIZON_S, (*trials[:5], wild, *trials[6:])), others).probability
    expected = predict_contact(HORIZON_S, learn_contact(HORIZON_S, trials), others).probability
    np.testing.assert_allclose(with_it, expected, atol=0.15)


def test_a_session_that_spreads_more_is_predicted_nearer_to_even_odds():
    rng = np.random.default_rng(SEED)
    learned = learn_contact(HORIZON_S, session(rng, 40, beside_m=0.005))
    other = session(rng, 30, beside_m=0.005)
    noisy = tuple(replace(t, d_m=t.d_m + rng.normal(0, 0.03, 3)) for t in other[:-1])
    exact, blurred = (predict_session(HORIZON_S, learned, (*t[:29], other[-1])).probability[-1] for t in (other, noisy))
    assert abs(blurred[1] - 0.5) < abs(exact[1] - 0.5)


def test_a_session_whose_offset_is_unknown_is_predicted_with_wider_intervals():
    """Its first trials: 2 cm of offset would turn a path that touches into one that does not."""
    rng = np.random.default_rng(SEED)
    learned, other = learn_contact(HORIZON_S, session(rng, 60, beside_m=0.008)), session(rng, 3)
    known, unknown = (of(HORIZON_S, learned, other) for of in (predict_contact, predict_session))
    widths = [(found.upper - found.lower)[:, :2].mean() for found in (known, unknown)]
    assert widths[1] > 3 * widths[0]


def still(at_m: list[float]) -> tuple[Trial, ...]:
    """Trials of an object that stands aside of the only taxel."""
    places = [np.tile([x, 0.0, 0.05], (3, 1, 1)) for x in at_m]
    return tuple(Trial(0.1 * np.arange(3), d, np.zeros_like(d), np.array([True])) for d in places)


@pytest.mark.parametrize(
    ("aside_cm", "mean", "within", "wander"),
    [([0, 2, 4, 6, 8, 10, 12, 14], 7, 2, 80 / 3 - 1), ([0, 1, 5], 2, 7, 0), ([3, 5], 4, 2, 0)],
    ids=["four blocks of two", "one block", "two trials"],
)
def test_where_a_session_aims_is_told_from_how_a_trial_strays(
    aside_cm: list[float], mean: float, within: float, wander: float
):
    """Worked out by hand: variance in blocks, and of the blocks' means less what that explains."""
    found = learn_contact(0.0, still([x / 100 for x in aside_cm])).session
    assert found is not None
    assert found.trials == len(aside_cm)
    assert 100 * found.mean_m == pytest.approx([mean, 0, 5])
    assert 1e4 * found.var_m2 == pytest.approx([within, 0, 0], abs=1e-9)
    assert 1e4 * found.wander_m2 == pytest.approx([wander, 0, 0], abs=1e-9)
    assert learn_contact(0.0, still([0.01])).session is None


def test_the_offset_of_a_session_is_believed_as_far_as_its_trials_agree():
    """Worked out by hand, in cm: a prior of 1.2², trials that stray by 1² about means of blocks that wander by 0.4,
    learned from four trials; then one out of reach, and three at 2, 0 and 4."""
    usual = SessionPaths(np.zeros(3), np.full(3, 1e-4), np.full(3, 0.4e-4), 4)
    learned = replace(learn_contact(0.0, still([0.0, 0.01])), session=usual)
    u = np.zeros((4, 1, 3))
    u[:, 0, 0] = np.nan, 0.02, 0.0, 0.04
    u[0] = np.nan
    mean, variance = _offsets(learned, Paths(u, np.zeros((4, 1), bool)))
    share = [0, *(1.44 / (1.44 + 1 / n + 1 / 4 + 0.4 * 5 / 4) for n in (1, 2, 3))]
    assert 100 * mean[:, 0] == pytest.approx([0, 2 * share[1], 1 * share[2], 2 * share[3]])
    assert not mean[:, 1:].any()
    more = [0, 0, (2 - 1.4) / (1 + 5), (8 - 2 * 1.4) / (2 + 5)]  # squares about the mean beyond those expected
    assert 1e4 * variance[:, 0] == pytest.approx([1.44 * (1 - s) + m for s, m in zip(share, more, strict=True)])
    assert 1e4 * variance[:, 1] == pytest.approx([1.44 * (1 - s) for s in share])


def test_where_a_path_is_adds_what_it_changes_to_the_uncertainty():
    """The log-odds of displaced paths under every hypothesis, drawn: their variance, and the mean probability."""
    rng, std_m = np.random.default_rng(SEED), np.array([0.0008, 0.0004, 0.0006])
    learned = learn_contact(HORIZON_S, session(rng, 24, beside_m=0.01))
    features, taxel = learned.features, np.zeros(1, int)
    assert features is not None
    u = features.middle_m[:1] + 0.7 * features.spread_m
    p, worth = _of_paths(learned, features, u, taxel, std_m[None] ** 2)
    X = features.of(u + std_m * rng.standard_normal((20_000, 3)), np.repeat(taxel, 20_000))
    mean, variance, probability = [], [], []
    for posterior in learned.posteriors:
        x = X[:, posterior.used]
        known = np.einsum("ni,ij,nj->n", x, posterior.cov, x).mean()
        mean.append(float((x @ posterior.mean).mean()))
        variance.append(float((x @ posterior.mean).var() + known))
        probability.append(expit(x @ posterior.mean).mean())
    whole = learned.weights @ (np.array(variance) + (np.array(mean) - learned.weights @ mean) ** 2)
    assert 1 / (worth * p * (1 - p)) == pytest.approx(whole, rel=0.03)
    assert p == pytest.approx(learned.weights @ probability, abs=0.05)


def test_the_features_of_a_path_are_standardised_and_robust():
    """Median and deviation of Gaussian paths, an influence like that of the t distribution's own, and a process of unit
    variance with a length of 1.6 deviations."""
    rng, sd = np.random.default_rng(SEED), np.array([0.01, 0.02, 0.0])
    taxel = rng.integers(0, 2, 4000)
    middle = np.array([[0.01, 0.0, 0.05], [0.03, 0.0, 0.05], [0.0, 0.0, 0.0]])  # no path to the third
    u = middle[taxel] + sd * rng.standard_normal((4000, 3))
    features = _features(u, taxel, 3)
    np.testing.assert_allclose(features.middle_m, middle, atol=0.002)
    np.testing.assert_allclose(features.common_m, [0.02, 0, 0.05], atol=0.002)
    np.testing.assert_allclose(features.spread_m, [0.01, 0.02, 0.003], rtol=0.05)  # at least 3 mm
    z, h = np.array([[1.0, 0.5, 1.0], [2.0, 0.0, 1.0], [0.0, 4.0, -6.0]]), 1e-5
    X = features.of(features.common_m + z * features.spread_m, np.array([0, 1, 2]))
    np.testing.assert_array_equal(X[:, :3], np.eye(3))
    density = multivariate_t(df=12, shape=np.eye(3))
    steps = [(density.logpdf(z - h * e) - density.logpdf(z + h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(X[1:, 3:6], np.stack(steps, axis=1)[1:], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(X[0, 3:6], z[0])  # what is near counts in full
    smooth = features.of(u, taxel)[:, 15:]
    np.testing.assert_allclose(smooth.mean(axis=0), 0, atol=1e-9)
    assert 12 < smooth.shape[1] <= 16
    at = u[np.linspace(0, 3999, 16).round().astype(int)]
    apart = features.of(at, np.zeros(16, int))[:, 3:6]
    process = features.of(at, np.zeros(16, int))[:, 15:] + features.offsets
    np.testing.assert_allclose(process @ process.T, RBF(1.6)(apart), atol=0.003)
