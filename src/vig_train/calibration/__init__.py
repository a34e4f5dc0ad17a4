"""Learns a `vig.inference.FitCalibration` on validation photos: when fits are right, how far they are off."""
