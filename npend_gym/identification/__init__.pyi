from npend_gym.identification.fit import identify as identify
from npend_gym.identification.fit import prediction_rmse as prediction_rmse
from npend_gym.identification.motion import Motion as Motion
from npend_gym.identification.recordings import read_motion as read_motion
from npend_gym.identification.result import Identification as Identification
from npend_gym.identification.swings import Swings as Swings
from npend_gym.identification.swings import measure_swings as measure_swings
