"""ROS 1 bags, ROS 2 bags and MCAP: topics, their messages, the events in them."""
