"""Read scenes, point clouds, depth images, recordings and saved models from files."""
