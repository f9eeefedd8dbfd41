"""Dense depth from photographs, and its fusion."""
