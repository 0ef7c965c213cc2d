"""Train a linear avoider on the vector environment with the cross-entropy method (some seconds).

pip install 'realitygap[gymnasium]'
python examples/learn.py [ITERATIONS]
"""

import sys

import gymnasium
import numpy as np

import realitygap.environment

gymnasium.register_envs(realitygap.environment)  # registers their names
ROBOTS, ELITE = 64, 8


def trial(env, weights, seed):
    """Scores of one trial of each robot with its own weights: tanh(W · observation + b)."""
    seen, _ = env.reset(seed=seed)
    total = np.zeros(ROBOTS)
    over = np.zeros(ROBOTS, bool)
    while not over.all():
        actions = np.tanh(np.einsum("nij,nj->ni", weights[:, :, :-1], seen) + weights[:, :, -1])
        seen, rewards, _, over, _ = env.step(actions.astype(np.float32))
        total += rewards
    return total


def main(iterations, seed=0):
    """Print the best and the mean score of each iteration; return the means."""
    env = gymnasium.make_vec(
        "realitygap/ObstacleAvoidance-v0", num_envs=ROBOTS, vectorization_mode="vector_entry_point"
    )
    random = np.random.default_rng(seed)
    mean, spread, means = np.zeros((2, 9)), np.ones((2, 9)), []
    for k in range(iterations):
        weights = mean + spread * random.normal(size=(ROBOTS, 2, 9))
        scores = sum(trial(env, weights, seed=1000 * k + 100 * one) for one in range(2)) / 2
        best = weights[np.argsort(scores)[-ELITE:]]
        mean, spread = best.mean(0), best.std(0) + 0.02
        print(f"iteration {k}: best {scores.max():.3f}, mean {scores.mean():.3f}")
        means.append(scores.mean())
    return means


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
