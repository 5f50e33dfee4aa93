"""Features followed by patches on images, by Lucas and Kanade."""
