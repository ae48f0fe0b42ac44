"""Films with known truth: ray-cast and rendered scenes, recordings of motions, disturbances and scores."""
