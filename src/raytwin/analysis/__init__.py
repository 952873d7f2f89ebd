"""What a scene's light is made of, and how little of it a task needs: light parts, ledger, ladder, recommendation."""
