from npend_gym.physics.equations import accelerations as accelerations
from npend_gym.physics.equations import mass_matrix as mass_matrix
from npend_gym.physics.equations import tensions as tensions
