"""Tables, figures and pages of results; cost and machine of a run."""
