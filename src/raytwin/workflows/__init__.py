"""What raytwin does when it is asked to: a file a job. Photos, methods and comparison are wired together here."""
