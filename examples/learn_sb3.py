"""Train Stable-Baselines3's PPO on the vector environment, half a million steps (half a minute of a core).

pip install 'realitygap[sb3]'
python examples/learn_sb3.py [STEPS]
"""

import sys

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import realitygap.environment
from realitygap.environment import stable_baselines

gymnasium.register_envs(realitygap.environment)  # registers their names
ROBOTS = 64


def make(robots, name="realitygap/ObstacleAvoidance-v0"):
    """A vector of robots for Stable-Baselines3."""
    settings = {"num_envs": robots, "vectorization_mode": "vector_entry_point", "autoreset_mode": "SameStep"}
    return stable_baselines(gymnasium.make_vec(name, **settings))


def main(steps):
    """Learn; print and return the mean score of the last hundred trials."""
    env = VecNormalize(VecMonitor(make(ROBOTS)), norm_obs=False)  # a step's reward is a small number
    learner = PPO("MlpPolicy", env, n_steps=100, batch_size=1600, gamma=0.99, seed=1, device="cpu")
    learner.learn(steps)
    score = np.mean([trial["r"] for trial in learner.ep_info_buffer])
    print(f"after {learner.num_timesteps} steps: mean score {score:.3f} of the last trials")
    return score


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500_000)
