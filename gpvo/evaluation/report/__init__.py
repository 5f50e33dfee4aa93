"""Tables, figures and pages for people; what a run cost and on which machine."""
