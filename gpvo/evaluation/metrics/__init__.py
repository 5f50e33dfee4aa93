"""The errors: the paper's, evo's, KITTI's, consistency; and what makes poses comparable."""
