"""Pictures of a geometry, and how scenes are drawn off screen."""
