from npend_gym.torch.checks import DivergedError as DivergedError
from npend_gym.torch.env import DifferentiableVectorEnv as DifferentiableVectorEnv
from npend_gym.torch.steps import step as step
from npend_gym.torch.torchrl import TorchRLEnv as TorchRLEnv
