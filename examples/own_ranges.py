"""Your own ranges, judged by the contract's own function: arrays in, verdicts out."""

import numpy as np

from wonderland_research import judge

ANCHORS = {"A1": (0.0, 0.0, 0.3), "A2": (6.0, 0.0, 2.5), "A3": (6.0, 6.0, 0.3), "A4": (0.0, 6.0, 2.5)}
places = np.array(list(ANCHORS.values()))

# Forty rounds, twenty a second, of a drone that crosses the pad; ranges with 3 cm of noise.
t_s = np.arange(40) / 20
path = np.stack([1.0 + t_s, 2.0 + 0.5 * t_s, np.full(40, 4.0)], axis=1)
ranges = np.linalg.norm(path[:, None, :] - places, axis=2) + np.random.default_rng(1).normal(0, 0.03, (40, 4))

for name, claims in {"the truth": path, "3 m further east": path + np.array([3.0, 0.0, 0.0])}.items():
    for window in judge(ranges, ANCHORS, claims, t_s=t_s, truth=path):
        found = window.line()
        print(
            f"{name}: {found['outcome']}, measured {found.get('error_m', float('nan')):.2f} m from the claim "
            f"and {found.get('truth_error_m', float('nan')):.2f} m from the truth"
        )

# The same with pandas: judge(frame, anchors, claims), and pandas.DataFrame(w.line() for w in windows).
# What is known of your anchors goes in as `commissioning`: `wonderland pad commission` finds it.
