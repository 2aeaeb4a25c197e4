from npend_gym.chain.model import Chain as Chain
from npend_gym.chain.model import check_chain as check_chain
from npend_gym.chain.parameters import FRICTION_SPEED as FRICTION_SPEED
from npend_gym.chain.parameters import MAX_DENSE as MAX_DENSE
from npend_gym.chain.parameters import MAX_RODS as MAX_RODS
from npend_gym.chain.parameters import STANDARD_GRAVITY as STANDARD_GRAVITY
from npend_gym.chain.parameters import ChainParameters as ChainParameters
from npend_gym.chain.parameters import check_parameter as check_parameter
