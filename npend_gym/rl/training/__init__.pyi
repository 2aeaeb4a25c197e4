from npend_gym.rl.training import es as es
from npend_gym.rl.training import imitation as imitation
from npend_gym.rl.training import ppo as ppo
from npend_gym.rl.training import robust_imitation as robust_imitation
from npend_gym.rl.training import robust_shac as robust_shac
from npend_gym.rl.training import shac as shac
