from .fitting import TrainingPlan as TrainingPlan, device_of as device_of
from .motion_noise import fit_env as fit_env
from .noise_profile import fit_noise as fit_noise
from .predictors import (
    TrainingRequest as TrainingRequest,
    train_predictor as train_predictor,
    training_windows as training_windows,
)
from .presence import fit_detector as fit_detector, fit_split as fit_split
from .split import open_split as open_split
from .tracklets import Windows as Windows, windows as windows
