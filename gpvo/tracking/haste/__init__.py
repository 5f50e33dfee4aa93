"""Features followed event by event, after HASTE."""
