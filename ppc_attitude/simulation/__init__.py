"""What is built from the science without ROS: scenario, closed loop, campaign, replay."""
