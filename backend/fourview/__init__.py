"""Four-view modelling: photos from several sides to a head of strands (Zhang et al. 2017)."""
