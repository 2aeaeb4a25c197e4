from npend_gym.physics.derivatives import DifferentiableEnsemble as DifferentiableEnsemble
from npend_gym.physics.derivatives import StepGradient as StepGradient
from npend_gym.physics.derivatives import StepJacobian as StepJacobian
from npend_gym.physics.ensemble import Ensemble as Ensemble
from npend_gym.physics.equations import accelerations as accelerations
from npend_gym.physics.equations import tensions as tensions
from npend_gym.physics.events import Event as Event
from npend_gym.physics.gpu import DeviceChains as DeviceChains
from npend_gym.physics.gpu_derivatives import (
    DifferentiableDeviceChains as DifferentiableDeviceChains,
)
from npend_gym.physics.gpu_simulation import simulate_on_device as simulate_on_device
from npend_gym.physics.integration import IntegrationError as IntegrationError
from npend_gym.physics.linearisation import Linearisation as Linearisation
from npend_gym.physics.linearisation import jacobian as jacobian
from npend_gym.physics.linearisation import linearise as linearise
from npend_gym.physics.linearisation import step_jacobian as step_jacobian
from npend_gym.physics.mass import mass_matrix as mass_matrix
from npend_gym.physics.mass import momentum_jacobian as momentum_jacobian
from npend_gym.physics.recipe import Recipe as Recipe
from npend_gym.physics.sensitivities import MotionGradient as MotionGradient
from npend_gym.physics.sensitivities import Sensitivities as Sensitivities
from npend_gym.physics.signals import Signal as Signal
from npend_gym.physics.simulation import simulate as simulate
from npend_gym.physics.trajectory import Trajectory as Trajectory
