#!/usr/bin/env python3
"""Average precision against an independent implementation, on random pictures.

The reference follows COCO's description with arrays over all thresholds at once; it finds the precision at each recall
by a maximum over all higher recalls, unlike Bolo's running maximum and binary search.

usage: average_precision_test.py PROGRAM
"""
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[2]))
from programs import needed  # noqa: E402

[np] = needed("numpy")
THRESHOLDS = np.linspace(0.5, 0.95, 10)
OBJECT, IGNORED, CROWD = range(3)


def overlap(boxes, truths, crowd):
    low = np.maximum(boxes[:, None, :2], truths[None, :, :2])
    high = np.minimum(boxes[:, None, :2] + boxes[:, None, 2:], truths[None, :, :2] + truths[None, :, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=2)
    sizes = np.prod(boxes[:, 2:], axis=1)[:, None]
    whole = np.where(crowd[None, :], sizes, sizes + np.prod(truths[:, 2:], axis=1)[None, :] - common)
    return common / whole


def matched(image, label):
    """(scores, right[t, d], counted[t, d], objects) of one picture and class."""
    truth = image["truth"][image["truth"][:, 0] == label]
    found = image["found"][image["found"][:, 0] == label]
    found = found[np.argsort(-found[:, 1], kind="stable")][:100]
    kinds = truth[:, 1].astype(int)
    ignored = kinds != OBJECT
    shared = overlap(found[:, 2:], truth[:, 2:], kinds == CROWD)
    right = np.zeros((len(THRESHOLDS), len(found)), bool)
    counted = np.ones_like(right)
    for t, threshold in enumerate(THRESHOLDS):
        free = np.ones(len(truth), bool)
        for d in range(len(found)):
            possible = free & (shared[d] >= threshold) if len(truth) else np.zeros(0, bool)
            for group in (possible & ~ignored, possible & ignored):
                if group.any():
                    # The last of equal ones, as in pycocotools.
                    choice = np.flatnonzero(group & (shared[d] == shared[d][group].max()))[-1]
                    free[choice] = kinds[choice] == CROWD
                    right[t, d] = not ignored[choice]
                    counted[t, d] = not ignored[choice]
                    break
    return found[:, 1], right, counted, int((~ignored).sum())


def class_ap(images, label):
    parts = [matched(image, label) for image in images]
    objects = sum(part[3] for part in parts)
    if objects == 0:
        return np.full(len(THRESHOLDS), np.nan)
    order = np.argsort(-np.concatenate([part[0] for part in parts]), kind="stable")
    right = np.concatenate([part[1] for part in parts], axis=1)[:, order]
    counted = np.concatenate([part[2] for part in parts], axis=1)[:, order]
    hits = np.cumsum(right & counted, axis=1)
    seen = np.cumsum(counted, axis=1)
    precision = np.divide(hits, seen, out=np.zeros(hits.shape), where=seen > 0)
    recall = hits / objects
    wanted = np.linspace(0, 1, 101)
    best = np.zeros((len(THRESHOLDS), 101))
    for t in range(len(THRESHOLDS)):
        reached = recall[t][None, :] >= wanted[:, None]
        best[t] = np.max(np.where(reached, precision[t][None, :], 0.0), axis=1, initial=0.0)
    return best.mean(axis=1)


def reference(images, labels):
    by_class = np.array([class_ap(images, label) for label in range(labels)])
    there = by_class[~np.isnan(by_class[:, 0])]
    return there.mean() if len(there) else np.nan


def boxes_near(random, count):
    corner = random.uniform(0, 400, (count, 2))
    return np.hstack([corner, random.uniform(6, 120, (count, 2))])


def picture(random, labels, kinds):
    count = random.integers(0, 9)
    truth = np.hstack([random.integers(0, labels, (count, 1)), random.choice(kinds, (count, 1)),
                       boxes_near(random, count)])
    near = truth[random.integers(0, count, 2 * count), 2:] if count else np.zeros((0, 4))
    near = near + random.normal(0, 1, near.shape) * near[:, [2, 3, 2, 3]] * random.choice([0.02, 0.1, 0.3])
    near[:, 2:] = np.abs(near[:, 2:]) + 1
    stray = boxes_near(random, random.integers(0, 130 if random.random() < 0.1 else 6))
    boxes = np.vstack([near, stray])
    # Scores of two digits, for ties.
    scores = np.round(random.uniform(0, 1, (len(boxes), 1)), 2)
    return {"truth": truth, "found": np.hstack([random.integers(0, labels, (len(boxes), 1)), scores, boxes])}


def text_of(images, labels):
    lines = [f"{labels} {len(images)}"]
    for image in images:
        lines.append(f"{len(image['truth'])} {len(image['found'])}")
        lines += [f"{int(r[0])} {int(r[1])} " + " ".join(repr(float(v)) for v in r[2:]) for r in image["truth"]]
        lines += [f"{int(r[0])} " + " ".join(repr(float(v)) for v in r[1:]) for r in image["found"]]
    return "\n".join(lines) + "\n"


def main():
    random = np.random.default_rng(5)
    worst, spread = 0.0, []
    for trial in range(60):
        labels = int(random.integers(1, 4))
        kinds = [OBJECT] if trial % 3 == 0 else [OBJECT, OBJECT, OBJECT, IGNORED, CROWD]
        images = [picture(random, labels, kinds) for _ in range(int(random.integers(1, 12)))]
        given = float(subprocess.run([sys.argv[1]], input=text_of(images, labels), text=True, capture_output=True,
                                     check=True).stdout)
        wanted = reference(images, labels)
        assert np.isnan(given) == np.isnan(wanted), (trial, given, wanted)
        if np.isnan(given):
            continue
        assert abs(given - wanted) < 1e-9, (trial, given, wanted)
        worst = max(worst, abs(given - wanted))
        spread.append(given)
    spread = np.array(spread)
    # The trials must discriminate: neither all good nor all bad.
    assert len(spread) > 40 and spread.min() < 0.2 and spread.max() > 0.5, spread
    print(f"{len(spread)} of 60 scored, AP {spread.min():.2f} to {spread.max():.2f}, largest difference {worst:.1e}")


if __name__ == "__main__":
    main()
