"""The simulator against closed forms, published figures and itself."""
