"""Events become clusters with surfaces of active events, section III-A.1 of the paper."""
