from npend_gym.rl.training import imitation as imitation
from npend_gym.rl.training import shac as shac
from npend_gym.rl.training.trainers import Trainer as Trainer
from npend_gym.rl.training.trainers import trainer as trainer
from npend_gym.rl.training.trainers import trainer_names as trainer_names
