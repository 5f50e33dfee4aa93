"""One configuration in the order of the stages, and the YAML file that it is read from."""
