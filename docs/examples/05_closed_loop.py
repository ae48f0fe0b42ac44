"""Close the loop: the eyes see an approach, the skin predicts a touch, the arm moves away."""

from dataclasses import replace

import numpy as np

import pps_vision as pv
from pps_vision.app.encounters.encounter import EncounterScene
from pps_vision.app.encounters.training import learn
from pps_vision.app.pipeline import PipelineParams
from pps_vision.app.simulation import log_of, make_episode, open_scene, simulate
from pps_vision.robot.silhouette import Silhouette
from tracking.tracker import TrackerParams

# a tenth of R's approaches to the left arm's skin, without rendering; pv.learn learns from recordings
memory = learn(EncounterScene(), "left", seed=0, share=0.1).probability

with open_scene(noise_sigma=2.0, seed=0) as scene:
    for avoid in (False, True):
        rng = np.random.default_rng(5)
        episode = make_episode("approach", scene, "left_forearm:3", "ball", rng, speed_m_s=0.15)
        tracker = pv.Tracker(TrackerParams(), scene.rig, rng, own_body=Silhouette(scene.robot))
        pipeline = pv.Pipeline(PipelineParams(), scene.robot, scene.skin, tracker, memory, rng)
        episode = replace(episode, seconds=episode.seconds / 2)  # until it withdraws
        steps = []
        for result in simulate(scene, episode, pipeline.step, avoid):  # result.step: track, activation, command
            steps.append(result)
            if result.touched.any():
                break
        log = log_of(scene, episode, steps, avoid)
        outcome = "touched" if log.was_touched else "not touched"
        print(f"avoidance {'on' if avoid else 'off'}: {outcome}, smallest gap {100 * log.surface_gap_m.min():.1f} cm")
