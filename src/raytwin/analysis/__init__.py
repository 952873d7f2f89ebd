"""What a scene's light is made of, and how little of it a task needs: converged reference, ledger, levels."""
