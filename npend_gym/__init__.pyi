from npend_gym import theory as theory
from npend_gym._version import __version__ as __version__
from npend_gym.chain import Chain as Chain
from npend_gym.period import pseudo_periods as pseudo_periods
from npend_gym.physics.simulate import IntegrationError as IntegrationError
from npend_gym.physics.simulate import Trajectory as Trajectory
from npend_gym.physics.simulate import simulate as simulate
