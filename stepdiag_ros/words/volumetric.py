"""What a volumetric accuracy is."""

DEFINITION = (
    "Volumetric accuracy: length of the largest error vector between the target and the actual"
    " position anywhere in the measured volume (RL), in the frame of the error curves; zero at the"
    " first corner. Reversal and repeatability are not in it."
)
NO_ERROR_ABOVE = "No error in the volume is larger than value + U (95 %)."
