"""Error metrics of the paper, evo and KITTI, consistency, association and alignment."""
